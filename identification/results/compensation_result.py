"""Result of a compensation for the Python API."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from identification.results.results_folder import ResultsFolder

if TYPE_CHECKING:
    import pandas as pd

    from identification.compensation.result import Compensation


class CompensationResult:
    """Result of `identification.compensate`.

    Attributes
    ----------
    compensation : the tables and their assessment.
    checklist : steps at the machine, in order.
    notes : warnings and remarks, as sentences.
    """

    def __init__(self, compensation: Compensation) -> None:
        self.compensation = compensation
        self.checklist = compensation.checklist
        self.notes = compensation.notes

    @property
    def files(self) -> dict[str, str]:
        """Text of each table file by its path in the folder of results."""
        return {f"{s.label}/{n}".lstrip("/"): text for s in self.compensation.sets for n, text in s.files.items()}

    @cached_property
    def figures(self) -> pd.DataFrame:
        """RMS and largest error (um) before, after an ideal compensation and after these tables, for each set."""
        import pandas as pd

        rows = [
            {"state": s.label, "poses": f.poses, "stage": stage}
            | {"rms_um": getattr(f, stage).rms_um, "worst_um": getattr(f, stage).worst_um}
            for s in self.compensation.sets
            for f in s.figures
            for stage in ("before", "ideal", "after")
        ]
        table = pd.DataFrame(rows)
        table.attrs["units"] = {"rms_um": "um", "worst_um": "um"}
        return table

    def summary(self, folder: str | Path = ".") -> str:
        """What the command line prints of tables that were written to `folder`."""
        from identification.compensation.text import compensation_lines

        return "\n".join(compensation_lines(self.compensation, Path(folder)))

    def write(self, folder: str | Path | ResultsFolder) -> Path:
        """Make a folder that of the controller's files, ``checklist.txt`` and ``compensation.json``, as a whole."""
        from identification.compensation.write import write_compensation

        out = folder if isinstance(folder, ResultsFolder) else ResultsFolder(Path(folder), "tables")
        out.check()
        with out.replaced() as part:
            write_compensation(self.compensation, part)
        return out.path

    def _repr_html_(self) -> str:
        steps = "".join(f"<li>{step}</li>" for step in self.checklist)
        return f"{self.figures.to_html(index=False)}<ol>{steps}</ol>"
