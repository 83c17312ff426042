"""Runs that differ, two lagged causes of one motion, and what a poor survey cannot show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errormodel.effects import make
from errormodel.effects.local_defect import LocalDefect
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.search.criteria import canonical_correlation
from identification.estimation.fit import fit_machine
from identification.observation.pose import Pose
from tests.helpers.diagnosed import FRAME, empty_survey, likely, showing
from tests.helpers.nightly import first_of

MEASURED = ["mx", "my", "mz"]
STATION = Pose(Rotation.from_rotvec(FRAME[1]).as_matrix(), np.array(FRAME[0])).invert(np.zeros((1, 3)))[0].tolist()


@pytest.mark.long
@pytest.mark.parametrize("name", first_of(["vertical_three_axis", "five_axis_table_quill"]))
def test_run_that_differs_by_a_constant(name: str) -> None:
    """An axis homed anew belongs to that axis, a moved instrument to the frame; each in its run."""
    machine = read_machine(name)
    survey = empty_survey(machine, 300, 5, channels=True, grid=False)
    table = survey.table.assign(run=np.repeat(["1", "2", "3"], 100))
    second = (table["run"] == "2").to_numpy()
    homed = table.copy()
    homed.loc[second, "X"] -= 0.012
    (finding,) = diagnose(machine, replace(survey, table=homed)).diagnosis.findings
    assert (finding.effect, finding.where, finding.motion, finding.runs) == ("unnamed", "X", ["dx"], ["2"])
    assert finding.probability > 0.9  # a name that is refused takes nothing from it
    moved = table.copy()
    moved.loc[second, MEASURED] += [0.012, -0.004, 0.007]
    (finding,) = diagnose(machine, replace(survey, table=moved)).diagnosis.findings
    assert finding.runs == ["2"]
    alike = {"target-offset"} if name == "vertical_three_axis" else set()  # where no axis turns, a target put back
    assert likely(finding) == {"station-shift", *alike}


@pytest.mark.long
def test_two_temperatures_of_one_motion() -> None:
    """What the air does at once and the bed an hour later, which heats every other 50 min, is one finding with both."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 7, channels=True, grid=False)
    table = survey.table.copy()
    time, rng = table["time"].to_numpy(), np.random.default_rng(1)
    table["T_0"] = 20 + 3 * np.sin(time / 900) + rng.normal(0, 0.03, len(table))
    heated, since = time // 3000 % 2 == 1, np.exp(-(time % 3000) / 900)
    bed = np.where(heated, 1 - since, np.where(time > 3000, since, 0.0))
    table["T_1"] = 21 + 3 * (1 - np.exp(-time / 2500)) + 3 * bed + rng.normal(0, 0.03, len(table))
    common = {"element": "column", "motion": "dy"}
    truth = (
        EffectSpec("structure-drift", {**common, "sensor": "T_0", "tau": 300.0}),
        EffectSpec("structure-drift", {**common, "sensor": "T_1", "tau": 2400.0}),
    )
    effects = list(zip(truth, ([0.006], [-0.009]), strict=True))
    result = diagnose(machine, showing(replace(survey, table=table), machine, effects, 0.004))
    (finding,) = result.diagnosis.findings
    assert finding.effect in ("structure-drift", "tracker-drift", "thermal-squareness", "warm-up")
    causes = {getattr(s.effect, "sensor", ""): getattr(s.effect, "tau", 0.0) for s in result.model.steps}
    assert causes["T_0"] == pytest.approx(300, rel=0.4)
    assert causes["T_1"] == pytest.approx(2400, rel=0.4)
    assert result.final.heldout.rms_um < 1.1 * np.sqrt(3) * 4


def test_poor_survey_says_what_it_cannot_show() -> None:
    """One tool, no time, no temperatures, an axis that moved one way: said with its place, and nothing made up."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 120, 5, channels=False, grid=True)
    table = survey.table.sort_values("X", kind="stable", ignore_index=True)
    diagnosis = diagnose(machine, replace(survey, table=table)).diagnosis
    assert not diagnosis.findings
    said = {(u.effect, u.reason) for u in diagnosis.untestable}
    assert ("backlash", "at X: X always arrived from the same side") in said
    reasons = dict(sorted(said))
    # a constant of the last member is the same; one that moves at some time needs a clock
    assert any("what the geometry leaves of it" in reason for effect, reason in said if effect == "target-offset")
    assert "temperature" in reasons["scale-expansion"]
    assert "time" in reasons["warm-up"]
    assert not {"eccentricity", "wobble", "gear-cyclic", "joint-compliance"} & {e for e, _ in said}, "no rotary joint"


@pytest.mark.long
@pytest.mark.parametrize(
    ("tau", "size", "seed", "name"),
    first_of(
        [
            (300.0, 0.005, 1, "vertical_three_axis"),
            (300.0, 0.005, 3, "trunnion_five_axis"),
            (100.0, 0.0025, 2, "bridge_cmm"),
            (100.0, 0.0025, 3, "trunnion_five_axis"),
            (1500.0, 0.005, 1, "vertical_three_axis"),
            (1500.0, 0.005, 2, "bridge_cmm"),
        ],
        2,
    ),
)
def test_noise_that_hangs_together_is_no_effect(tau: float, size: float, seed: int, name: str) -> None:
    machine = read_machine(name)
    survey = empty_survey(machine, 250, seed, channels=True, grid=False)
    table, rng = survey.table.copy(), np.random.default_rng(seed + 999)
    steps, drift = rng.normal(size=(len(table), 3)), np.zeros((len(table), 3))
    keep = np.exp(-np.diff(table["time"].to_numpy()) / tau)
    drift[0] = steps[0]
    for k, a in enumerate(keep, start=1):
        drift[k] = a * drift[k - 1] + np.sqrt(1 - a * a) * steps[k]
    table[MEASURED] += size * drift
    findings = diagnose(machine, replace(survey, table=table)).diagnosis.findings
    assert not findings, [f.statement for f in findings]


ONE_CAUSE = {
    "scale of one run": (EffectSpec("scale-ppm", {"run": "2", "station": STATION}), [4e-5], "frame"),
    "load that sinks alike everywhere": (
        EffectSpec("payload-sag", {"joint": "Z", "motion": "dz", "degree": 0}),
        [5e-5],
        "Y",  # as any of the axes: they sink alike
    ),
    "member by the clock": (
        EffectSpec("warm-up", {"element": "column", "motion": "ea", "tau": 1800.0}),
        [6e-5],
        "column",
    ),
    "station that slid": (EffectSpec("station-shift", {"at": 4200.0, "turned": False}), [0.01, -0.006, 0.004], "frame"),
}


@pytest.mark.parametrize("name", first_of(sorted(ONE_CAUSE)))
def test_one_cause_has_its_name(name: str) -> None:
    spec, values, where = ONE_CAUSE[name]
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 300, 9, channels=True, grid=False)
    table = survey.table.assign(run=np.repeat(["1", "2", "3"], 100), load=np.tile(np.repeat([0.0, 300.0], 25), 6))
    result = diagnose(machine, showing(replace(survey, table=table), machine, [(spec, values)], 0.004))
    (finding,) = result.diagnosis.findings
    assert finding.effect == spec.effect
    assert finding.where == where
    main = result.model.findings[0][0]
    start = result.model.start
    assert canonical_correlation(start, start.columns(make(spec))[0], start.columns(main.effect)[0]) > 0.999
    assert main.evidence <= main.marginal  # what noise that goes along from row to row leaves of it
    assert finding.probability > 0.5


def test_a_dent_has_a_slope_where_its_flanks_were_measured() -> None:
    """At the only level within its width any slope fits, which is ten times as large beside it."""
    machine = read_machine("vertical_three_axis")
    for grid in (False, True):
        scene = set_up(fit_machine(machine, empty_survey(machine, 300, 5, channels=False, grid=grid))).scene
        proposed = list(LocalDefect.proposals(scene))
        assert proposed
        assert any(d.tilt for d in proposed if isinstance(d, LocalDefect)) != grid
