"""Result of a fit of rows that were streamed: that of any fit, and residuals of all rows if they are wanted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from identification.results.analysis import Analysis
from identification.results.fit_result import FitResult
from identification.runtime.progress import Steps, uncounted

if TYPE_CHECKING:
    from errormodel.survey_rows import SurveyRows
    from identification.estimation.result import Fit

RESIDUALS = "residuals.parquet"


class StreamedFitResult(FitResult):
    """Result of `identification.fit_stream`.

    ``fit.survey`` and ``residuals`` are of a sample of the rows, ``fit.rows`` is the number of all. With
    `all_residuals` `save` reads the rows once more, and writes ``residuals.parquet`` of all of them.
    """

    def __init__(self, fit: Fit, rows: SurveyRows, all_residuals: bool = False, steps: Steps = uncounted) -> None:
        super().__init__(fit)
        self._rows, self._all, self._steps = rows, all_residuals, steps

    @property
    def pace(self) -> str:
        """How fast the rows went through, and what share of it was reading."""
        s = self.fit.streamed
        assert s is not None
        share = s.reading / max(s.reading + s.computing, 1e-9)
        passed = s.rows * s.passes
        return (
            f"{s.rows} rows in {s.seconds:.1f} s, {passed / max(s.seconds, 1e-9):.0f} rows a second; of the work on "
            f"them {100 * share:.0f} % was reading and checking"
        )

    def _write(self, folder: Path) -> None:
        if self._all:
            from identification.streaming.residual_rows import write_residuals

            with self._steps("Writing residuals of all rows") as report:
                self.fit = write_residuals(self.fit, self._rows, folder / RESIDUALS, report)
            self.analysis = Analysis(self.fit)
        super()._write(folder)
