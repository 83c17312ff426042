"""Result of a fit for the Python API: tables with units, figures, prediction, storage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.results.analysis import Analysis
from identification.results.results_folder import ResultsFolder
from identification.runtime.memory import give_back
from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from xarray import DataTree

    from errormodel.machine import Machine
    from identification.estimation.result import Fit, Spread
    from identification.results.stored_fit import Axes, StoredFit
    from identification.sources import AnySurvey

STATISTICS_COLUMNS = ("rms_um", "mean_um", "max_um", "n")  # columns of the table of residual statistics


class FitResult:
    """Result of `identification.fit`; tables are computed on request.

    Attributes
    ----------
    fit : the estimates and residuals behind it.
    analysis : what is derived from them: parameters, uncertainty budgets (GUM), further poses, posterior.
    machine : the machine that was fitted.
    notes : warnings and remarks, as sentences.
    sigma_um : standard uncertainty of one measured coordinate (k = 1), um.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        self.analysis = Analysis(fit)

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
        """One row a base parameter: ``group`` (formula), ISO ``symbol``, ``value``, ``std`` (k = 1), ``unit``.

        ``members`` are the parameters of its group with their coefficients.
        """
        import pandas as pd

        columns = ["id", "group", "symbol", "value", "std", "unit", "members"]
        table = pd.DataFrame(self.analysis.groups, columns=columns).set_index("id")
        table.attrs["units"] = table["unit"].to_dict()
        return table

    @cached_property
    def covariance(self) -> pd.DataFrame:
        """Covariance of the base parameters, in products of their units."""
        import pandas as pd

        names = list(self.parameters.index)
        return pd.DataFrame(self.fit.solution.covariance * self.fit.inflation**2, index=names, columns=names)

    @cached_property
    def budget(self) -> pd.DataFrame:
        """Uncertainty budget (GUM) of the predicted error where it is known worst: one row an input.

        ``std`` in ``unit``, ``contribution`` in mm; ``attrs`` has the measurand, the combined standard uncertainty, its
        degrees of freedom, the coverage factor and the expanded uncertainty. No rows if no position was measured.
        """
        import pandas as pd

        columns = ["name", "type", "distribution", "std", "unit", "sensitivity", "contribution", "dof"]
        worst = self.analysis.budgets.prediction
        rows = [] if worst is None else [{c: getattr(i, c) for c in columns} for i in worst.inputs]
        table = pd.DataFrame(rows, columns=columns)
        if worst is not None:
            whole = worst.as_json()
            table.attrs.update({name: value for name, value in whole.items() if name != "inputs"})
        return table

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

    @cached_property
    def posterior(self) -> DataTree:
        """Draws of a Bayesian fit as ArviZ takes them: groups posterior, prior, log_likelihood and others.

        Raises
        ------
        InputError
            The fit has no posterior.
        InputError
            ArviZ is not installed (``pip install errormodel[arviz]``); ``posterior.nc`` of `save` needs none.
        """
        from errormodel.exceptions import InputError
        from identification.bayes.netcdf import as_tree

        if self.fit.posterior is None:
            raise InputError("posterior", "the fit is by least squares", "Write fit(machine, survey, bayes=True)")
        return as_tree(self.fit, self.fit.posterior)

    @property
    def plot(self) -> FitPlots:
        """Figures of the fit, each a matplotlib figure."""
        return FitPlots(self.analysis)

    @property
    def stored(self) -> StoredFit:
        """What prediction needs of the fit."""
        return self.analysis.stored

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.results.text import fit_lines

        return "\n".join(fit_lines(self.analysis))

    def predict(self, points: AnySurvey, axes: Axes = "measured") -> pd.DataFrame:
        """The same as `identification.predict` with this result."""
        from identification.results.predictions import predicted
        from identification.sources import survey_of

        return predicted(replace(self.stored, error_axes=axes), survey_of(points, self.machine, measured=False))

    def report(self) -> str:
        """The report, as HTML that holds all it shows."""
        from identification.report import report

        return report(self.analysis)

    def save(
        self,
        folder: str | Path | ResultsFolder,
        *,
        report: bool | Callable[[], str] = False,
        progress: Progress = silent,
    ) -> Path:
        """Make a folder that of this result, as a whole or not at all.

        Parameters
        ----------
        folder : str, Path or ResultsFolder
        report : bool or callable
            Whether ``report.html`` is in it; or what gives its text.
        progress : callable
            Called with the name of each long part; returns a context manager around it.
        """
        out = folder if isinstance(folder, ResultsFolder) else ResultsFolder(Path(folder))
        out.check()
        give_back()
        with out.replaced() as part:
            with progress("Writing tables"):
                self._write(part)
            if report:
                from errormodel.files import write_text_atomic

                give_back()
                with progress("Drawing the report"):
                    write_text_atomic(report() if callable(report) else self.report(), part / "report.html")
        return out.path

    def _write(self, folder: Path) -> None:
        from identification.results import store

        store.write(self.analysis, folder)
        if self.fit.posterior is not None:
            from identification.bayes.netcdf import write_netcdf

            write_netcdf(self.fit, self.fit.posterior, folder / "posterior.nc")

    def __repr__(self) -> str:
        groups = self.fit.solution.groups.rank
        return f"<{type(self).__name__}: {self.machine.name}, {self.fit.rows} rows, {groups} groups>"

    def _repr_html_(self) -> str:
        from html import escape

        shown = self.parameters.drop(columns="members")
        head = shown.head(12).to_html(float_format=lambda x: f"{x:.4g}")
        more = f"<p>and {len(shown) - 12} more groups</p>" if len(shown) > 12 else ""
        figures = self.statistics.to_html(float_format=lambda x: f"{x:.2f}")
        return f"<h3>{escape(self.machine.name)}</h3>{figures}{head}{more}"


class FitPlots:
    """Figures of a fit."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis, self._fit = analysis, analysis.fit

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

        return draw_parameters(self._analysis)

    def correlation(self) -> Figure:
        """Correlation of the base parameters."""
        from identification.plots.correlation import draw_correlation

        return draw_correlation(self._analysis)

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
