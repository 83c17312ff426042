"""Text of the thermal model's result for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from errormodel.conventions import unit_of
from identification.results.parameter_table import printed
from identification.thermal_drift.drift_model import MotionResult, Thermal

TEMPERATURES_SHOWN = 3  # per error motion, the first that were selected


def thermal_lines(result: Thermal) -> Iterator[str]:
    """Sensors, a line for each error motion, and what was gained."""
    r = result.recordings
    several = [" = ".join(g) for g in r.groups if len(g) > 1]
    yield f"{result.fit.chain.machine.name}: {len(result.motions)} error motions, {len(r.groups)} groups of sensors"
    if several:
        yield f"read alike to a correlation of 0.999, the first stands for all: {'; '.join(several)}"
    for name, reason in r.left_out.items():
        yield f"{name} is left out: {reason}"
    yield ""
    yield "rms in the other cycle       drift   regression      lagged     noise   follows (sensor behind a lag)"
    for m in result.motions:
        factor, unit = printed(unit_of(m.motion))
        name, unit = m.symbol or f"{m.joint}.{m.motion}", unit.replace("µ", "u")
        numbers = (m.drift, m.stepwise, m.lagged, m.noise)
        figures = "  ".join(f"{factor * v:{w}.2f}" for v, w in zip(numbers, (8, 11, 10, 8), strict=True))
        yield f"  {name:6} {unit:4}          {figures}   {_follows(m)}"
    usual, lagged = result.left_beyond
    yield ""
    yield (
        f"left beyond the noise, in noise: {usual:.2f} by stepwise regression at each position, {lagged:.2f} by a few "
        "lagged temperatures"
    )


def _follows(motion: MotionResult) -> str:
    """The first selected temperatures of an error motion with their lags."""
    said = [f"{f.sensor}{f' {f.tau / 60:.0f} min' if f.tau else ''}" for f in motion.follows[:TEMPERATURES_SHOWN]]
    more = len(motion.follows) - TEMPERATURES_SHOWN
    return ", ".join(said) + (f" and {more} more" if more > 0 else "") or "nothing"
