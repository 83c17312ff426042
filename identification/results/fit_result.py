"""Result of a fit for the Python API: tables with units, figures, prediction, storage."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from errormodel.machine import Machine
    from identification.api import AnySurvey
    from identification.estimation.result import Fit, Spread
    from identification.results.store import StoredFit

STATISTICS_COLUMNS = ("rms_um", "mean_um", "max_um", "n")  # columns of the table of residual statistics


class FitResult:
    """Result of `identification.fit`; tables are computed on request.

    Attributes
    ----------
    fit : the estimates and residuals behind it.
    machine : the machine that was fitted.
    notes : warnings and remarks, as sentences.
    sigma_um : standard uncertainty of one measured coordinate (k = 1), um.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit

    @property
    def machine(self) -> Machine:
        return self.fit.chain.machine

    @property
    def notes(self) -> tuple[str, ...]:
        return self.fit.notes

    @property
    def sigma_um(self) -> float:
        return 1e3 * self.fit.sigma_mm

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.fit.solution.dof

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """One row per base parameter: ``group`` (formula), ISO ``symbol``, ``value``, ``std`` (k = 1), ``unit``."""
        import pandas as pd

        from identification.results import store

        columns = ["id", "group", "symbol", "value", "std", "unit"]
        table = pd.DataFrame(store.parameters(self.fit), columns=columns).set_index("id")
        table.attrs["units"] = table["unit"].to_dict()
        return table

    @cached_property
    def covariance(self) -> pd.DataFrame:
        """Covariance of the base parameters, in products of their units."""
        import pandas as pd

        names = list(self.parameters.index)
        return pd.DataFrame(self.fit.solution.covariance * self.fit.inflation**2, index=names, columns=names)

    @cached_property
    def residuals(self) -> pd.DataFrame:
        """One row per measurement: nominal, fitted and held-out residual, um, measured minus predicted."""
        from identification.results import store

        table = store.residual_table(self.fit)
        table.attrs["units"] = {name: "um" for name in table.columns if name.endswith("_um")}
        return table

    @cached_property
    def statistics(self) -> pd.DataFrame:
        """RMS, mean and largest 3-D residual (um) and rows: nominal, fitted, held out, each test file."""
        spreads = {"nominal": self.fit.nominal, "fitted": self.fit.fitted, "held out": self.fit.heldout}
        spreads |= {f"test {t.path}": t.fitted for t in self.fit.tests}
        return spread_table(spreads)

    @property
    def plot(self) -> FitPlots:
        """Figures of the fit, each a matplotlib figure."""
        return FitPlots(self.fit)

    @cached_property
    def stored(self) -> StoredFit:
        """The part of the fit that prediction needs."""
        from identification.results import store

        return store.stored(self.fit)

    def predict(self, points: AnySurvey) -> pd.DataFrame:
        """The same as `identification.predict` with this result."""
        from identification.api import predict

        return predict(self, points)

    def save(self, folder: str | Path, *, report: bool = False) -> Path:
        """Write this result to a folder, all or nothing; with `report`, ``report.html`` as well."""
        from identification.results.results_folder import ResultsFolder

        out = ResultsFolder(Path(folder))
        out.check()
        with out.replaced() as part:
            self._write(part)
            if report:
                self._write_report(part / "report.html")
        return out.path

    def _write(self, folder: Path) -> None:
        from identification.results import store

        store.write(self.fit, folder)

    def _write_report(self, path: Path) -> None:
        from identification.report import write_report

        write_report(self.fit, path)

    def __repr__(self) -> str:
        groups = self.fit.solution.groups.rank
        return f"<{type(self).__name__}: {self.machine.name}, {len(self.fit.survey)} rows, {groups} groups>"

    def _repr_html_(self) -> str:
        from html import escape

        head = self.parameters.head(12).to_html(float_format=lambda x: f"{x:.4g}")
        more = f"<p>and {len(self.parameters) - 12} more groups</p>" if len(self.parameters) > 12 else ""
        figures = self.statistics.to_html(float_format=lambda x: f"{x:.2f}")
        return f"<h3>{escape(self.machine.name)}</h3>{figures}{head}{more}"


class FitPlots:
    """Figures of a fit."""

    def __init__(self, fit: Fit) -> None:
        self._fit = fit

    def residuals(self) -> Figure:
        """Residuals against the position of each joint."""
        from identification.plots.residuals import draw_residuals_by_position

        return draw_residuals_by_position(self._fit)

    def residuals_by_order(self) -> Figure:
        """Residuals in the order of measuring."""
        from identification.plots.residuals import draw_residuals_by_order

        return draw_residuals_by_order(self._fit)

    def errors(self) -> Figure:
        """Error vectors in the working volume, before and after the fit."""
        from identification.plots.volumetric_error import draw_volumetric_error

        return draw_volumetric_error(self._fit)

    def distribution(self) -> Figure:
        """Distribution of the size of the error: nominal, fitted, held out, test."""
        from identification.plots.error_distribution import draw_error_distribution

        return draw_error_distribution(self._fit)

    def motions(self, joint: str) -> Figure:
        """Identified error motions of a joint over its travel, with bands of two standard uncertainties."""
        from errormodel.exceptions import InputError, nearest
        from identification.plots.error_motions import draw_error_motions, moving_joints

        joints = {j.name: j for j in moving_joints(self._fit)}
        if joint not in joints:
            raise InputError("motions", f"no identified error motion of a joint '{joint}'", nearest(joint, joints))
        return draw_error_motions(self._fit, joints[joint])

    def parameters(self) -> Figure:
        """Values of all base parameters with two standard uncertainties."""
        from identification.plots.parameters import draw_parameters

        return draw_parameters(self._fit)

    def correlation(self) -> Figure:
        """Correlation of the base parameters."""
        from identification.plots.correlation import draw_correlation

        return draw_correlation(self._fit)

    def singular_values(self) -> Figure:
        """Singular values of the scaled design matrix."""
        from identification.plots.singular_values import draw_singular_values

        return draw_singular_values(self._fit)


def spread_table(spreads: dict[str, Spread]) -> pd.DataFrame:
    """Statistics of residuals, one row each."""
    import pandas as pd

    rows: list[dict[str, Any]] = [{name: getattr(s, name) for name in STATISTICS_COLUMNS} for s in spreads.values()]
    table = pd.DataFrame(rows, index=list(spreads), columns=list(STATISTICS_COLUMNS))
    table.attrs["units"] = dict.fromkeys(STATISTICS_COLUMNS[:3], "um")
    return table
