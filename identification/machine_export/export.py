"""A description written, read back by its own reader, and compared with the machine that it is of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import ErrorModelError, InputError
from errormodel.machine import Machine
from errormodel.machine_formats.base import Extras, MachineFormat, Part, Template, described, format_named, nominal
from errormodel.raw_formats.base import RawFile, open_raw
from identification.compensation.conditions import state_words
from identification.compensation.field import Field, other_states
from identification.compensation.options import with_load
from identification.compensation.rows import joints_read, read_rows
from identification.compensation.volume import Volume
from identification.machine_export.geometry import Calibrated, calibrated, nominal_rows, poses_of
from identification.results import store
from identification.results.terminal import one_line
from identification.runtime.progress import Progress, silent

READ_BACK_POSES = 1000
# what reading back may change: all formats hold constant geometry exactly, and rounding of ten metres leaves 1e-11 mm
READ_BACK_MM, READ_BACK_RAD = 1e-6, 1e-9


@dataclass(frozen=True)
class Exported:
    """A description of a machine.

    Attributes
    ----------
    kind : its format.
    machine : what it describes: nominal geometry only, mm and rad.
    text : of the file.
    notes : sentences.
    read_back : largest difference of what is read from the text, mm and rad, over `READ_BACK_POSES` random poses.
    calibrated : of a fit, what the description holds of it.
    """

    kind: type[MachineFormat]
    machine: Machine
    text: str
    notes: tuple[str, ...]
    read_back: tuple[float, float]
    calibrated: Calibrated | None = None


def exported(
    source: Path | Machine,
    name: str,
    suffix: str,
    identity: str = "",
    into: Path | None = None,
    part: Part | None = None,
    seed: int = 0,
    progress: Progress = silent,
    *,
    load: float | None = None,
) -> Exported:
    """Describe a machine, or the machine that was fitted into a folder.

    Parameters
    ----------
    source : the folder of a fit, or a machine, of which the nominal geometry is described.
    name : word of the format.
    suffix : of the file, where a format has several forms.
    identity : the format's own identifier, where it has one.
    into : a description that is kept but for its geometry; `part` : the chain in it that is meant.
    load : load that the constants are for, kg; None: the median of the survey's rows.

    Raises
    ------
    InputError
        There is no such format, it cannot hold this machine, or the folder holds no fit.
    """
    kind = format_named(name)
    if identity and not kind.identified:
        raise InputError("--hash", f"'{identity}', and {kind.title} holds no identifier of a robot", "Leave it out")
    if load is not None and isinstance(source, Machine):
        raise InputError("--load", f"{load:g} kg, where a machine without a fit yields to no load", "Leave it out")
    template = None if into is None else open_raw(into, str(into))
    known, unlisted = (None, ()) if isinstance(source, Machine) else _of_fit(source, load, progress)
    machine = nominal(source) if isinstance(source, Machine) else known.machine if known else None
    assert machine is not None
    what = "calibrated" if known else "nominal"
    state = f", at {state_words(known.state)}" if known and known.state else ""
    heading = f"errormodel: {what} geometry of {' '.join(one_line(machine.name).split())}{state}"
    with progress("Writing and reading it back"):
        if template is None:
            written = kind.write(machine, suffix, Extras(heading, identity))
        else:
            before = machine if known is None else known.nominal
            written = kind.rewrite(machine, Template(template, part or Part(), before))
        end = np.eye(4) if written.end is None else written.end
        read_back = compared(kind, machine, written.text, suffix, end, seed, part if template else None)
    return Exported(kind, machine, written.text, (*unlisted, *written.notes), read_back, known)


def _of_fit(folder: Path, load: float | None, progress: Progress) -> tuple[Calibrated, tuple[str, ...]]:
    """What a description holds of a fit, and what is said of its folder."""
    with progress("Reading"):
        fit = store.load(folder)
        table = read_rows(folder, fit.chain.machine)
    with progress("Finding the constant geometry"):
        field, of_load = with_load(Field.of(fit, table), load, table)
        volume = Volume.of(field, table, fit.frame_mode != "fixed", turns=joints_read(table) is None)
        tool = {i: fit.values[i] for i in fit.chain.tool_ids if i in fit.values}
        others = other_states(field, table, [{}], [*field.conditions])
        return calibrated(field, volume, tool, others), (*fit.unlisted, *of_load)


def compared(
    kind: type[MachineFormat], machine: Machine, text: str, suffix: str, end: Array, seed: int, part: Part | None = None
) -> tuple[float, float]:
    """Largest difference, mm and rad, between a machine and what a format's reader makes of its text.

    Raises
    ------
    ErrorModelError
        They differ: the text must not be used.
    """
    raw = RawFile(Path(f"written{suffix}"), f"what was written for --format {kind.name}", text.encode())
    back = replace(machine, elements=described(raw, kind.name, part or Part()).elements, tool=(0.0, 0.0, 0.0))
    low, high = np.array([j.travel for j in machine.joints]).T
    q = np.random.default_rng(seed).uniform(low, high, (READ_BACK_POSES, len(low)))
    one, other = Chain(machine), Chain(back)
    point, turn = poses_of(one, np.zeros(len(one.ids)), nominal_rows(machine, q))
    place, turned = poses_of(other, np.zeros(len(other.ids)), nominal_rows(back, q))
    place = place + turned @ (end[:3, :3] @ np.array(machine.tool) + end[:3, 3])
    found = float(np.linalg.norm(place - point, axis=1).max()), float(np.abs(turned @ end[:3, :3] - turn).max())
    if found[0] > READ_BACK_MM or found[1] > READ_BACK_RAD:
        raise ErrorModelError(
            f"--format {kind.name}: what was written reads back {found[0]:.3g} mm and {found[1]:.3g} rad away from the "
            "machine, and was not put in place; please report this with the machine's file"
        )
    return found
