"""Fit or diagnosis read back from its folder, for the Python API."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.results.stored_fit import Axes, StoredFit

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.machine import Machine
    from errormodel.survey import Survey
    from identification.sources import AnySurvey


@dataclass(frozen=True)
class SavedFit:
    """Result of `identification.load`.

    Attributes
    ----------
    stored : the part of the fit that prediction needs.
    folder : folder from which it was read.
    """

    stored: StoredFit
    folder: Path

    @classmethod
    def of(cls, folder: Path) -> SavedFit:
        """Read the folder of a fit or a diagnosis."""
        from identification.results import store

        return cls(store.load(folder), folder)

    @property
    def machine(self) -> Machine:
        return self.stored.chain.machine

    @property
    def notes(self) -> tuple[str, ...]:
        """What cannot be checked of the folder, and what was assumed of measuring frames and signs, as sentences."""
        from identification.observation.frames import rotation_notes

        return (*self.stored.unlisted, *rotation_notes(self.stored.frames), *self.stored.sign_notes)

    @property
    def data(self) -> dict[str, Any]:
        """Content of ``fit.json`` in the folder."""
        return self.stored.data

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """One row per base parameter: ``group`` (formula), ISO ``symbol``, ``value``, ``std`` (k = 1), ``unit``."""
        import pandas as pd

        columns = ["group", "symbol", "value", "std", "unit", "members"]
        table = pd.DataFrame(self.data["parameters"]).set_index("id")[columns]
        table.attrs["units"] = table["unit"].to_dict()
        return table

    def predict(self, points: AnySurvey, axes: Axes = "measured") -> pd.DataFrame:
        """The same as `identification.predict` with this result."""
        from identification.results.predictions import predicted
        from identification.sources import survey_of

        return predicted(replace(self.stored, error_axes=axes), survey_of(points, self.machine, measured=False))

    def notes_on(self, commands: Survey, axes: Axes = "measured") -> tuple[str, ...]:
        """Sentences on commands: what their reading assumed, and where they lie outside of what was measured."""
        from identification.results.predictions import notes_on

        return notes_on(replace(self.stored, error_axes=axes), commands)

    def __repr__(self) -> str:
        return f"<SavedFit: {self.machine.name}, {len(self.stored.base)} groups, {self.folder}>"
