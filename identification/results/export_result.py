"""Descriptions of machines for the Python API: what was read, and what was written."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from identification.results.output_file import OutputFile

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.machine import Machine
    from identification.machine_export.export import Exported


class ExportResult:
    """Result of `identification.export`.

    Attributes
    ----------
    text : the description.
    notes : what the format has no place for, and what to know of it, as sentences.
    read_back_mm : largest distance (mm) between the functional point of the machine and of what is read from the text.
    """

    def __init__(self, exported: Exported) -> None:
        self.exported = exported
        self.text = exported.text
        self.notes = exported.notes
        self.read_back_mm = exported.read_back[0]

    @cached_property
    def figures(self) -> pd.DataFrame:
        """Errors (um) against the fitted machine over the measured volume, of the nominal geometry and of this."""
        import pandas as pd

        from identification.compensation.conditions import state_words

        known = self.exported.calibrated
        spreads = {} if known is None else {"nominal": known.before, "description": known.left}
        spreads |= {f"description at {state_words(s)}": there for s, there in (known.others if known else ())}
        table = pd.DataFrame([{"geometry": name, **vars(s)} for name, s in spreads.items()])
        table.attrs["units"] = {"rms_um": "um", "worst_um": "um"}
        return table

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.machine_export.text import export_lines

        return "\n".join(export_lines(self.exported))

    def write(self, path: str | Path | OutputFile) -> Path:
        """Write the description to a file, which replaces nothing that errormodel did not write."""
        out = path if isinstance(path, OutputFile) else OutputFile(Path(path))
        out.write_text(self.text)
        return out.path


class MachineImport:
    """Result of `identification.import_machine`.

    Attributes
    ----------
    machine : with the error motions that it is calibrated by.
    notes : how the description was read, as sentences.
    """

    def __init__(self, machine: Machine, notes: tuple[str, ...]) -> None:
        self.machine, self.notes = machine, notes

    @cached_property
    def text(self) -> str:
        """The ``machine.yaml``."""
        from errormodel.machine_file import machine_text

        return machine_text(self.machine)

    def summary(self) -> str:
        """What the command line prints of it."""
        joints = ", ".join(f"{j.name} ({j.type})" for j in self.machine.joints)
        members = ", ".join(s.name for s in self.machine.shapes)
        return f"{self.machine.name}: joints {joints}; members {members}"

    def write(self, path: str | Path | OutputFile) -> Path:
        """Write the ``machine.yaml``, which replaces nothing that errormodel did not write."""
        out = path if isinstance(path, OutputFile) else OutputFile(Path(path))
        out.write_text(self.text)
        return out.path
