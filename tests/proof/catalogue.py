"""All concealed effects by name."""

from __future__ import annotations

from collections.abc import Callable

from tests.proof import physics_beams as beams
from tests.proof import physics_drives as drives
from tests.proof import physics_instrument as instrument
from tests.proof import physics_thermal as thermal
from tests.proof import physics_unnamed as unnamed
from tests.proof.hidden import Hidden, Rng
from tests.proof.kinematics import Chain

Builder = Callable[[Chain, Rng], Hidden | None]

NAMED: dict[str, Builder] = {
    "scale-expansion": thermal.scale_expansion,
    "screw-heat": thermal.screw_heat,
    "warm-up": thermal.warm_up,
    "spindle-growth": thermal.spindle_growth,
    "structure-drift": thermal.structure_drift,
    "thermal-squareness": thermal.thermal_squareness,
    "thermal-bending": thermal.thermal_bending,
    "backlash": drives.backlash,
    "lost-motion": drives.lost_motion,
    "hysteresis": drives.hysteresis,
    "pitch-cyclic": drives.pitch_cyclic,
    "rail-waviness": drives.rail_waviness,
    "eccentricity": drives.eccentricity,
    "wobble": drives.wobble,
    "gear-cyclic": drives.gear_cyclic,
    "servo-lag": drives.servo_lag,
    "compensation-active": drives.compensation_active,
    "higher-order-geometry": drives.higher_order_geometry,
    "local-defect": drives.local_defect,
    "contact-knee": drives.contact_knee,
    "ram-sag": beams.ram_sag,
    "beam-sag": beams.beam_sag,
    "beam-torsion": beams.beam_torsion,
    "column-bending": beams.column_bending,
    "cross-axis-compliance": beams.cross_axis_compliance,
    "telescoping-compliance": beams.telescoping,
    "ground-compliance": beams.ground_compliance,
    "payload-sag": beams.payload_sag,
    "joint-compliance": beams.joint_compliance,
    "gantry-racking": beams.gantry_racking,
    "tracker-drift": instrument.tracker_drift,
    "tilting-tripod": instrument.tilting_tripod,
    "station-shift": instrument.station_shift,
    "refraction": instrument.air_refraction,
    "target-offset": instrument.target_offset,
    "clock-offset": instrument.clock_offset,
}
UNNAMED: dict[str, Builder] = {
    "chequer": unnamed.chequer,
    "humidity": unnamed.humidity,
    "humid-scale": unnamed.humid_scale,
    "pressure-side": unnamed.pressure_side,
    "current-step": unnamed.current_step,
    "triple": unnamed.triple,
    "feed-nod": unnamed.feed_nod,
    "lubrication": unnamed.lubrication,
    "beat": unnamed.beat,
    "cusp": unnamed.cusp,
}
UNSEEN: dict[str, tuple[Builder, str]] = {  # with the plan on which they cannot be seen
    "scale-ppm": (instrument.scale_ppm, "random"),
    "steady-refraction": (instrument.refraction, "rows"),
    "target-lost": (instrument.target_lost, "grid"),
    "one-way-backlash": (drives.one_way_backlash, "oneway"),
}
PAIRS = (
    ("structure-drift", "tracker-drift"), ("backlash", "servo-lag"), ("backlash", "lost-motion"),
    ("warm-up", "scale-expansion"), ("warm-up", "structure-drift"), ("ram-sag", "higher-order-geometry"),
    ("beam-sag", "thermal-bending"), ("cross-axis-compliance", "gantry-racking"), ("pitch-cyclic", "rail-waviness"),
    ("eccentricity", "wobble"), ("column-bending", "ground-compliance"), ("station-shift", "tracker-drift"),
    ("target-offset", "spindle-growth"), ("local-defect", "contact-knee"), ("gear-cyclic", "eccentricity"),
)  # fmt: skip
BUILDERS = NAMED | UNNAMED | {name: builder for name, (builder, _) in UNSEEN.items()}
