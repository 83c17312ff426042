"""Fit or diagnosis read back from its folder, for the Python API."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.results.store import StoredFit

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.machine import Machine
    from identification.api import AnySurvey


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
    def data(self) -> dict[str, Any]:
        """Content of ``fit.json`` in the folder."""
        return self.stored.data

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """One row per base parameter: ``group`` (formula), ISO ``symbol``, ``value``, ``std`` (k = 1), ``unit``."""
        import pandas as pd

        table = pd.DataFrame(self.data["parameters"]).set_index("id")[["group", "symbol", "value", "std", "unit"]]
        table.attrs["units"] = table["unit"].to_dict()
        return table

    def predict(self, points: AnySurvey) -> pd.DataFrame:
        """The same as `identification.predict` with this result."""
        from identification.api import predict

        return predict(self, points)

    def __repr__(self) -> str:
        return f"<SavedFit: {self.machine.name}, {len(self.stored.base)} groups, {self.folder}>"
