"""Thermal model as a section of the report."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from errormodel.conventions import unit_of
from identification.plots.thermal_drift import draw_thermal_drift
from identification.report.pictures import Picture, picture
from identification.report.tables import number
from identification.results.parameter_table import printed
from identification.thermal_drift.drift_model import MotionResult, Thermal

# times the noise: a larger error on another cycle means that the model does not transfer; by judgement
POOR_TRANSFER_RATIO = 3.0


class ThermalPart(NamedTuple):
    """Sentences, tables and figures of the section."""

    headline: str
    good: bool
    statement: str
    notes: list[str]
    motions: list[list[str]]
    drawn: list[Picture]


def thermal_part(result: Thermal) -> ThermalPart:
    """Content of the section."""
    r = result.recordings
    usual, lagged = result.left_beyond
    several = "; ".join(" = ".join(g) for g in r.groups if len(g) > 1)
    notes = [f"{name} drives nothing: {reason}" for name, reason in r.left_out.items()]
    if several:
        notes.append(f"sensors that read alike, of which the first stands for all: {several}")
    files = ", ".join(dict.fromkeys(r.survey.test[k].table["file"].iloc[0] for k in range(len(r.survey.test))))
    return ThermalPart(
        f"Drift of {len(result.motions)} error motions with temperature: in another thermal cycle the model leaves "
        f"{lagged:.2g} times the noise, beyond the noise"
        f"{'' if lagged < POOR_TRANSFER_RATIO else ': it does not carry over'}.",
        lagged < POOR_TRANSFER_RATIO,
        f"Each error motion follows a few temperatures behind lags. In a thermal cycle that was not fitted ({files}) "
        f"that leaves {lagged:.2f} times the noise, in the root mean square beyond it; stepwise regressions on "
        f"temperatures at each position leave {usual:.2f} times.",
        [*notes, *r.notes],
        [_row(m) for m in result.motions],
        [
            picture(
                partial(draw_thermal_drift, result),
                "Predicted minus measured in the cycle that was not fitted, each recording from its own zero. A motion "
                "is predicted when its dots fill the grey band and no more.",
                "One panel an error motion: what the thermal model and the regressions miss over the hours",
            )
        ],
    )


def _row(m: MotionResult) -> list[str]:
    factor, unit = printed(unit_of(m.motion))
    follows = [
        f"{f.sensor}{f' {f.tau / 60:.0f} min' if f.tau else ''}{', along the travel' if f.order else ''}"
        for f in m.follows
    ]
    figures = [number(factor * v, 2) for v in (m.drift, m.stepwise, m.lagged, m.noise)]
    return [m.symbol or f"{m.joint}.{m.motion}", *figures, unit, "; ".join(follows) or "nothing"]
