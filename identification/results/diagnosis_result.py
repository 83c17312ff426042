"""Result of a diagnosis for the Python API."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from identification.results.fit_result import FitPlots, FitResult

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from identification.diagnosis.pipeline import Diagnosed

# columns of the table of findings
FINDING_COLUMNS = ("effect", "where", "motion", "driver", "probability", "statement")


class DiagnosisResult(FitResult):
    """Result of `identification.diagnose`: the fit of the extended machine, and the findings.

    Attributes
    ----------
    diagnosed : the findings and both fits.
    baseline : the fit of the machine as it was given.
    """

    def __init__(self, diagnosed: Diagnosed) -> None:
        super().__init__(diagnosed.final)
        self.diagnosed = diagnosed
        self.baseline = FitResult(diagnosed.baseline)

    @property
    def notes(self) -> tuple[str, ...]:
        return self.diagnosed.diagnosis.notes

    @property
    def verdict(self) -> str:
        """``adequate``, ``explained``, ``partly-explained`` or ``unexplained``."""
        return self.diagnosed.diagnosis.verdict

    @cached_property
    def findings(self) -> pd.DataFrame:
        """One row per finding, the strongest first."""
        import pandas as pd

        rows = [f.as_json() for f in self.diagnosed.diagnosis.findings]
        return pd.DataFrame(
            [{name: row[name] for name in FINDING_COLUMNS} for row in rows], columns=list(FINDING_COLUMNS)
        )

    @cached_property
    def untestable(self) -> pd.DataFrame:
        """Effects that this survey cannot test, the reason, and the measurement needed."""
        import pandas as pd

        rows = [vars(u) for u in self.diagnosed.diagnosis.untestable]
        return pd.DataFrame(rows, columns=["effect", "reason", "needs"])

    @property
    def plot(self) -> DiagnosisPlots:
        return DiagnosisPlots(self.diagnosed)

    def _write(self, folder: Path) -> None:
        from errormodel.files import write_text_atomic
        from identification.results import store

        super()._write(folder)
        write_text_atomic(store.dumps(self.diagnosed.diagnosis.as_json()), folder / "diagnosis.json")

    def _write_report(self, path: Path) -> None:
        from identification.report import write_report

        write_report(self.fit, path, self.diagnosed)

    def _repr_html_(self) -> str:
        found = self.findings.to_html(index=False) if len(self.findings) else "<p>nothing was found</p>"
        return f"<p>verdict: {self.verdict}</p>{found}{super()._repr_html_()}"


class DiagnosisPlots(FitPlots):
    """Figures of a diagnosis, and of the fit of the extended machine."""

    def __init__(self, diagnosed: Diagnosed) -> None:
        super().__init__(diagnosed.final)
        self._diagnosed = diagnosed

    def where(self) -> Figure:
        """Map of the share of the plain fit's residuals that each effect explains, by place."""
        from errormodel.exceptions import InputError
        from identification.plots.where_map import draw_where_map

        if not self._diagnosed.diagnosis.findings:
            raise InputError("where", "nothing was found that a map could show", "Look at residuals() instead")
        return draw_where_map(self._diagnosed.model, self._diagnosed.ranking, [])
