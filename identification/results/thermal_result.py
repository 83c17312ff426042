"""A thermal model as a notebook uses it."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.results.analysis import Analysis
from identification.results.fit_result import FitPlots, FitResult

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from identification.thermal_drift.drift_model import Thermal

MOTION = ("joint", "motion", "symbol", "drift", "stepwise", "lagged", "noise", "rows")


class ThermalResult(FitResult):
    """What `identification.thermal` returns: the fit of the machine with its drifts, and how well they are predicted.

    Attributes
    ----------
    thermal : the recordings as they were used, each error motion, and the predictions of the other cycle.
    """

    def __init__(self, thermal: Thermal) -> None:
        super().__init__(thermal.fit)
        self.thermal = thermal

    @property
    def notes(self) -> tuple[str, ...]:
        return tuple(self.thermal.recordings.notes)

    @cached_property
    def motions(self) -> pd.DataFrame:
        """One row an error motion: root mean squares (mm or rad) in the cycle that was not fitted.

        ``drift`` with no model, ``stepwise`` by regression at each position, ``lagged`` by the model that was fitted,
        ``noise`` of one reading; ``follows`` names the temperatures.
        """
        import pandas as pd

        rows: list[dict[str, Any]] = [
            {name: getattr(m, name) for name in MOTION} | {"follows": ", ".join(f.sensor for f in m.follows)}
            for m in self.thermal.motions
        ]
        return pd.DataFrame(rows, columns=[*MOTION, "follows"])

    @property
    def plot(self) -> ThermalPlots:
        return ThermalPlots(self.analysis, self.thermal)

    def summary(self) -> str:
        from identification.thermal_drift.text import thermal_lines

        return "\n".join(thermal_lines(self.thermal))

    def report(self) -> str:
        from identification.report import report

        return report(self.analysis, thermal=self.thermal)

    def _write(self, folder: Path) -> None:
        from errormodel.files import write_text_atomic
        from identification.plots import style
        from identification.results.json_text import dumps

        super()._write(folder)
        write_text_atomic(dumps(self.thermal.as_json()), folder / "thermal.json")
        style.save(self.plot.drift(), folder / "thermal_drift.png")


class ThermalPlots(FitPlots):
    """Figures of a thermal model, and of its fit."""

    def __init__(self, analysis: Analysis, thermal: Thermal) -> None:
        super().__init__(analysis)
        self._thermal = thermal

    def drift(self) -> Figure:
        """Drifts of a cycle that was not fitted: measured, by the model, and by regressions."""
        from identification.plots.thermal_drift import draw_thermal_drift

        return draw_thermal_drift(self._thermal)
