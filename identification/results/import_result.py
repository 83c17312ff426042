"""A survey made of raw files, as a notebook and the command line use it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from errormodel.survey import Survey
    from identification.importing.importing import Imported
    from identification.results.results_folder import ResultsFolder

PICTURE = "join.png"  # measured points on the commanded ones


class ImportResult:
    """What `identification.import_survey` returns.

    Attributes
    ----------
    imported : the files that were read, what was joined, and its proof.
    survey : the survey, as `fit` and `diagnose` will read it.
    notes : what needs attention, as sentences.
    """

    def __init__(self, imported: Imported) -> None:
        self.imported = imported
        self.survey: Survey = imported.survey
        self.notes = imported.notes

    def summary(self) -> str:
        """What the command line prints of it: the proof of the join."""
        from identification.importing.text import import_lines

        return "\n".join(import_lines(self.imported))

    def save(self, folder: ResultsFolder | Path | str) -> None:
        """Write the raw files as they came, ``survey.yaml`` that maps them, the pairs of rows, and a picture.

        Raises
        ------
        InputError
            The folder holds files that errormodel did not write, or that were changed since.
        """
        from errormodel.files import write_bytes_atomic, write_text_atomic
        from identification.importing.text import import_lines
        from identification.plots.join import draw_join, draw_lengths
        from identification.plots.style import save
        from identification.results.results_folder import ResultsFolder

        place = folder if isinstance(folder, ResultsFolder) else ResultsFolder(Path(folder), holds="survey")
        with place.replaced() as part:
            for name, data in self.imported.files.items():
                write_bytes_atomic(data, part / name)
            write_text_atomic("\n".join(import_lines(self.imported)) + "\n", part / "import.txt")
            if len(self.imported.proof.rows):
                save(draw_join(self.imported), part / PICTURE)
            elif self.imported.set_ups.lengths:
                save(draw_lengths(self.imported.set_ups.lengths), part / PICTURE)
