"""Result of a diagnosis for the Python API."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from identification.results.analysis import Analysis
from identification.results.fit_result import FitPlots, FitResult

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from identification.diagnosis.results.diagnosed import Diagnosed
    from identification.diagnosis.search.scoring import Step
    from identification.results.explanation import Explanation
    from identification.results.residual_projection import Evidence

FINDING_COLUMNS = ("effect", "where", "motion", "driver", "probability", "statement", "moved")


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
        """One row a finding, the strongest first; ``moved`` is how far its absence had pushed other parameters."""
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

    @cached_property
    def decisions(self) -> pd.DataFrame:
        """The decision log: one row a decision, with its stage, rule, candidate, value, threshold and outcome."""
        return self.explain().decisions

    def explain(self, effect: str | None = None) -> Explanation:
        """The same as `identification.explain` with this result."""
        from identification.results.explanation import Explanation

        return Explanation(list(self.diagnosed.log), self.diagnosed.diagnosis.as_json(), effect)

    @property
    def _places(self) -> list[tuple[str, str]]:
        return [(f.effect, f.where) for f in self.diagnosed.diagnosis.findings]

    @property
    def plot(self) -> DiagnosisPlots:
        return DiagnosisPlots(self.analysis, self.diagnosed)

    def _write(self, folder: Path) -> None:
        from errormodel.files import write_csv, write_text_atomic
        from identification.diagnosis.decisions import summary
        from identification.results.json_text import dumps

        super()._write(folder)
        short = {"decisions": summary.short(self.diagnosed.log, self._places)}
        write_text_atomic(dumps(self.diagnosed.diagnosis.as_json() | short), folder / "diagnosis.json")
        write_csv(self.decisions, folder / "decisions.csv")

    def summary(self) -> str:
        from identification.results.text import diagnosis_lines

        return "\n".join(diagnosis_lines(self.diagnosed.diagnosis))

    def report(self) -> str:
        from identification.report import report

        return report(self.analysis, self.diagnosed)

    def _repr_html_(self) -> str:
        found = self.findings.to_html(index=False) if len(self.findings) else "<p>nothing was found</p>"
        return f"<p>verdict: {self.verdict}</p>{found}{super()._repr_html_()}"


class DiagnosisPlots(FitPlots):
    """Figures of a diagnosis, and of the fit of the extended machine."""

    def __init__(self, analysis: Analysis, diagnosed: Diagnosed) -> None:
        super().__init__(analysis)
        self._diagnosed = diagnosed

    def where(self) -> Figure:
        """Map of the share of the plain fit's residuals that each effect explains, by place."""
        from errormodel.exceptions import InputError
        from identification.plots.where_map import draw_where_map

        if not self._diagnosed.diagnosis.findings:
            raise InputError("where", "nothing was found that a map could show", "Look at residuals() instead")
        return draw_where_map(self._diagnosed.model, self._diagnosed.ranking, list(self._numbered.items()))

    def finding(self, number: int) -> Figure:
        """Residuals along the driver of a finding, by its number from 1: without it and with it."""
        from identification.diagnosis.linear.row_residuals import noise_mm
        from identification.plots.residuals_along_driver import draw_residuals_along_driver

        return draw_residuals_along_driver(self._evidence(number), noise_mm(self._fit))

    def effect(self, number: int) -> Figure:
        """What a finding, by its number from 1, adds to the machine's motions, with two standard uncertainties."""
        from identification.plots.effect_curve import draw_effect_curve

        return draw_effect_curve(self._evidence(number), self._diagnosed.model, self._fit)

    @cached_property
    def _numbered(self) -> dict[int, Sequence[Step]]:
        from identification.diagnosis.results.diagnosed import numbered

        return numbered(self._diagnosed)

    def _evidence(self, number: int) -> Evidence:
        from errormodel.exceptions import InputError
        from identification.results.residual_projection import evidence_of

        if number not in self._numbered:
            known = ", ".join(map(str, self._numbered)) or "none"
            raise InputError("finding", f"there is no curve of a finding {number}", f"Findings with curves: {known}")
        return evidence_of(self._diagnosed.model, self._numbered[number])
