"""Evaluations by standards as a notebook uses them: figures, decisions, charts, the certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.conformity.decision import Conformity
from identification.iso_standards.base import COVERAGE_FACTOR
from identification.results.results_folder import ResultsFolder
from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from errormodel.surveys.record import RecordForm
    from identification.iso_standards.base import Evaluation

SCHEMA = "errormodel.iso/1"
COVERAGE = 0.95  # of an expanded uncertainty with k = 2, about
# units of the figures, and of the numbers under `test`, as the D-SI of digital calibration certificates writes them
UNITS = {
    "figures": {"mm": r"\milli\metre", "rad": r"\radian", "1": r"\one", "rad/mm": r"\radian\milli\metre\tothe{-1}"},
    "test": {
        "ambient": {
            "temperature": r"\degreecelsius", "machine_temperature": r"\degreecelsius", "temperature_range": r"\kelvin",
            "humidity": r"\percent", "pressure": r"\hecto\pascal",
        },
        "uncertainty": {
            "device": r"\milli\metre", "misalignment": r"\milli\metre", "environment": r"\milli\metre",
            "temperature": r"\kelvin", "coefficient": r"\kelvin\tothe{-1}", "coefficient_bound": r"\kelvin\tothe{-1}",
        },
    },
}  # fmt: skip
COLUMNS = ("standard", "name", "words", "value", "expanded", "unit", "basis")


class EvaluationResult:
    """Result of `identification.iso`.

    Attributes
    ----------
    machine : name of the machine.
    evaluations : one a standard: quantities, tables, charts, notes.
    conformity : the decisions on what has a tolerance.
    record : the block ``test:`` of the survey; None where it has none.
    inputs : digests (SHA-256) of the files that were read, by name.
    notes : what the evaluations remark, and what was left out.
    survey_notes : those of them that are about the survey's rows: what was assumed, or left out.
    """

    def __init__(
        self,
        machine: str,
        evaluations: Sequence[Evaluation],
        conformity: Conformity,
        record: RecordForm | None,
        inputs: Sequence[tuple[str, str]],
        notes: Sequence[str] = (),
    ) -> None:
        self.machine = machine
        self.evaluations = tuple(evaluations)
        self.conformity = conformity
        self.record = record
        self.inputs = tuple(inputs)
        self.survey_notes = tuple(notes)
        self.notes = (*notes, *(f"{e.number}: {note}" for e in self.evaluations for note in e.notes))

    @cached_property
    def figures(self) -> pd.DataFrame:
        """One row a quantity: ``value`` and ``expanded`` (k = 2) in ``unit``, as they are printed (um, urad)."""
        import pandas as pd

        from identification.results.parameter_table import printed

        rows = []
        for e in self.evaluations:
            for q in e.quantities:
                factor, unit = printed(q.unit)
                expanded = None if q.expanded is None else factor * q.expanded
                rows.append((e.number, q.name, q.words, factor * q.value, expanded, unit, q.basis))
        return pd.DataFrame(rows, columns=list(COLUMNS))

    @property
    def verdict(self) -> str | None:
        """passes, fails, cannot be decided; None where there is no tolerance."""
        return self.conformity.verdict

    @property
    def plots(self) -> Mapping[str, Figure]:
        """The charts by their names, each a matplotlib figure."""
        return {c.name: c.draw() for e in self.evaluations for c in e.charts}

    @property
    def missing(self) -> tuple[str, ...]:
        """What the block ``test:`` lacks for a certificate, as keys."""
        from errormodel.surveys.record import RecordForm

        missing = (RecordForm() if self.record is None else self.record).missing()
        return tuple(name for name in missing if name != "tolerance" or not self.conformity.judgements)

    def as_json(self) -> dict[str, Any]:
        """All of it, as ``evaluation.json`` has it: mm and rad."""
        from errormodel import __version__

        return {
            "schema": SCHEMA,
            "version": __version__,
            "machine": self.machine,
            "test": None if self.record is None else self.record.model_dump(exclude_defaults=True),
            "missing": list(self.missing),
            "units": UNITS,
            "coverage": {"k": COVERAGE_FACTOR, "probability": COVERAGE},
            "verdict": self.verdict,
            "conformity": self.conformity.as_json(),
            "standards": [
                {
                    "number": e.number,
                    "title": e.title,
                    "source": e.source,
                    "quantities": [q.as_json() for q in e.quantities],
                    "notes": list(e.notes),
                    "data": e.data,
                }
                for e in self.evaluations
            ],
            "inputs": [{"name": name, "sha256": digest} for name, digest in self.inputs],
            "notes": list(self.notes),
        }

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.conformity.text import evaluation_lines

        return "\n".join(evaluation_lines(self))

    def certificate(self) -> str:
        """The certificate, as HTML that holds all it shows."""
        from identification.report.certificate import certificate

        return certificate(self)

    def save(self, folder: str | Path | ResultsFolder, *, progress: Progress = silent) -> Path:
        """Write ``certificate.html``, ``evaluation.json``, ``figures.csv`` and the charts, as a whole or not at all.

        Parameters
        ----------
        folder : str, Path or ResultsFolder
        progress : callable
            Called with the name of each long part; returns a context manager around it.

        Returns
        -------
        Path
            The folder.
        """
        from errormodel.files import write_csv, write_text_atomic
        from identification.plots import style
        from identification.results.json_text import dumps

        out = folder if isinstance(folder, ResultsFolder) else ResultsFolder(Path(folder), "evaluation")
        out.check()
        with out.replaced() as part, progress("Drawing the certificate"):
            write_text_atomic(dumps(self.as_json()), part / "evaluation.json")
            write_csv(self.figures, part / "figures.csv")
            for e in self.evaluations:
                for k, chart in enumerate(e.charts, start=1):
                    style.save(chart.draw(), part / "charts" / f"{e.number}_{k}.svg")
            write_text_atomic(self.certificate(), part / "certificate.html")
        return out.path

    def _repr_html_(self) -> str:
        return f"<p>{self.verdict or 'no tolerance stated'}</p>{self.figures.to_html(index=False)}"
