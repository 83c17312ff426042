"""Machines in the formats of others: robots into machine files, calibrated machines into descriptions."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    from errormodel.machine import Machine
    from identification.results.export_result import ExportResult, MachineImport
    from identification.results.fit_result import FitResult


def import_machine(
    file: str | Path,
    *,
    format: str = "",  # noqa: A002  the word of the command
    base: str = "",
    tip: str = "",
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    joints: str | Sequence[str] = (),
    name: str = "",
) -> MachineImport:
    """Read a robot's description: URDF, Denavit-Hartenberg tables, a calibration of Universal Robots.

    Parameters
    ----------
    file : str or Path
    format : str
        A name of `machine_formats`; empty: the one that recognises the file.
    base, tip : str
        Links between which the chain lies, where the description is a tree; empty: its root, and its only end.
    tool : (x, y, z)
        Functional point in the last frame, mm.
    joints : str or sequence of str
        Names of the joints in the order of the chain, or with commas between; empty: those of the file.
    name : str
        Of the machine; empty: that of the file.

    Returns
    -------
    MachineImport
        ``machine``, ``text`` (the ``machine.yaml``), ``notes``, ``write(path)``.

    Raises
    ------
    InputError
        The file cannot be read, or describes no serial chain of commanded joints.
    """
    from identification.machine_export.importing import imported
    from identification.results.export_result import MachineImport

    names = tuple(n.strip() for n in joints.split(",")) if isinstance(joints, str) and joints else tuple(joints)
    machine, notes = imported(Path(file), format, base, tip, tool, names, name)
    return MachineImport(machine, notes)


def export(
    source: FitResult | Machine | str | Path,
    format: str,  # noqa: A002  the word of the command
    *,
    suffix: str = "",
    identity: str = "",
    into: str | Path | None = None,
    base: str = "",
    tip: str = "",
    load: float | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> ExportResult:
    """Describe a calibrated machine, or the nominal one of a file, in a format of others.

    The text is read back, and compared with the machine over random poses. What a description cannot hold (error
    motions over a joint's position, compliance and other effects) is replaced by the nearest constants, and said with
    its size.

    Parameters
    ----------
    source : FitResult, DiagnosisResult, Machine, str or Path
        A result, the folder that one was saved in, or a machine.
    format : str
        A name of `machine_formats`.
    suffix : str
        Of the file, such as ``".yaml"``, where a format has several forms.
    identity : str
        The format's own identifier, where it has one: the hash of a robot.
    into : str, Path or None
        The robot's own description: the text is this file with other origins of its joints, and all else as it is.
    base, tip : str
        Links of `into` between which the chain lies, as for `import_machine`.
    load : float, optional
        Load that the constants are for, kg. Default: the median of the survey's rows.
    seed : int
        Of the random poses.
    progress : callable
        Called with the name of each long part; returns a context manager around it.

    Returns
    -------
    ExportResult
        ``text``, ``notes``, ``read_back_mm``, ``figures``, ``summary()``, ``write(path)``.

    Raises
    ------
    InputError
        There is no such format, or it cannot hold this machine.
    """
    from errormodel.machine import Machine
    from errormodel.machine_formats.base import Part
    from identification.machine_export.export import Exported, exported
    from identification.results import manifest
    from identification.results.export_result import ExportResult
    from identification.sources import machine_of

    kept = None if into is None else Path(into)

    def made(place: Path | Machine) -> Exported:
        return exported(place, format, suffix, identity, kept, Part(base, tip), seed, progress, load=load)

    if isinstance(source, Machine):
        return ExportResult(made(source))
    if isinstance(source, str | Path):
        values = Path(source) / "fit.json"
        fitted = values.is_file() or manifest.lists(values)  # a fit that lost its values is no plain machine
        return ExportResult(made(Path(source) if fitted else machine_of(source)))
    with tempfile.TemporaryDirectory() as folder:
        return ExportResult(made(source.save(Path(folder) / "fit")))


def machine_formats() -> dict[str, str]:
    """Formats of descriptions that `import_machine` reads and `export` writes.

    Returns
    -------
    dict
        What each is, by its name.
    """
    from errormodel.machine_formats.base import registry

    return {name: kind.title for name, kind in registry().items()}
