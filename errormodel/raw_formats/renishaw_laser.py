"""Files of Renishaw laser software (Laser10, LaserXL): ``.rtl`` (linear), ``.rta`` (angular), ``.rts`` (straightness).

Sections end with ``::``. Targets are in mm or degrees; linear and straightness deviations are in micrometres, measured
minus target. Odd runs go forward, even ones back. Public readers do not agree on the unit of angular deviations, so
that the user is asked. Along which axis a straightness or an angle was measured is not in the file either.
"""

from __future__ import annotations

import re

import numpy as np

from errormodel.conventions import MOTIONS, unit_of
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.positioning import DEVIATION, joint_for, motion_rows

_ENVIRONMENT = {"air temp": "T_air", "mat temp 1": "T_material_1", "mat temp 2": "T_material_2",
                "mat temp 3": "T_material_3"}  # fmt: skip
_SECTION = re.compile(r"^\s*([A-Z][A-Z \-]*)::")
_KEY = re.compile(r"^\s*([A-Za-z][\w .\-]*?)\s*:\s*(.*)$")


class RenishawLaser(RawFormat):
    """Targets, runs and deviations of a laser interferometer."""

    name = "renishaw-laser"
    title = "a file of Renishaw laser software"
    source = "public readers of such files, among them StoneWolfCJQ/LinearCalc, Manufactor/RENISHAW.cs"
    uses = ("joint",)

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        return raw.text is not None and "TARGET DATA::" in raw.text and "DEVIATIONS::" in raw.text

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        keys, targets, rows, lines = _sections(raw)
        if not targets or not rows:
            raise InputError(raw.name, "no targets or no deviations", "Give the file as the laser software wrote it")
        kind = f"{keys.get('file type', '')} {keys.get('filetype', '')} {raw.path.suffix}".lower()
        straight = "straight" in kind or ".rts" in kind
        angular = "ang" in kind or "rotary" in kind or ".rta" in kind
        joint = joint_for(raw.name, asked, keys.get("axis", ""), rotary="rotary" in kind)
        number = np.array([r[1] for r in rows])
        if number.min() < 1 or number.max() > len(targets):
            row = int(np.argmax((number < 1) | (number > len(targets))))
            found = f"target {number[row]} of {len(targets)}"
            raise InputError(f"{raw.name}, line {lines[row]}", found, "Give the file as the laser software wrote it")
        runs = np.array([r[0] for r in rows])
        both = _bidirectional(runs, number)
        run = [str((r + 1) // 2 if both else r) for r in runs]
        side = np.where(runs % 2 == 1, 1.0, -1.0) if both else np.full(len(rows), np.nan)
        position = np.array([targets[k - 1] for k in number])
        if np.all(np.diff(targets) < 0):
            side = -side
        deviation = np.array([r[2] for r in rows])
        frame = motion_rows(joint, position, deviation, "um", run, side, linear=not (straight or angular))
        notes = [*raw.notes, f"{len(targets)} targets, {len(np.unique(runs))} runs{', both ways' if both else ''}"]
        units = {joint.name: "deg" if joint.type == "rotary" else "mm"}
        units |= {name: unit_of(name) for name in MOTIONS if name in frame}
        if straight:
            units[DEVIATION] = "um"
            notes.append(f"say which straightness it is: --columns dy={DEVIATION} (or dx, dz)")
        elif angular:
            notes.append(f"say which angle it is, and its unit: --columns eb={DEVIATION} --units eb=urad")
        for key, name in _ENVIRONMENT.items():
            value = re.match(r"[-+]?\d+(\.\d+)?", keys.get(key, ""))
            if value:
                frame[name] = float(value[0])
        return Recording(frame, units, tuple(lines), tuple(notes))


def _sections(raw: RawFile) -> tuple[dict[str, str], list[float], list[tuple[int, int, float]], list[int]]:
    """Keys of all sections, targets, and (run, target, deviation) with their lines."""
    keys: dict[str, str] = {}
    targets: list[float] = []
    rows: list[tuple[int, int, float]] = []
    lines: list[int] = []
    section = reading = ""
    for number, text in enumerate(raw.lines, start=1):
        line, head = text, _SECTION.match(text)
        if head:
            section, reading = head[1].strip(), ""
            line = text[head.end() :]
        key = _KEY.match(line)
        if key and not key[2].startswith(":"):
            reading = key[1].strip().lower()
            keys[reading] = key[2].strip()
            line = key[2]
        where = f"{raw.name}, line {number}"
        if section == "TARGET DATA" and reading == "targets":
            targets += [_number(where, word) for word in line.split()]
        elif section == "DEVIATIONS" and (cells := line.split()) and cells[0].removeprefix("-").isdecimal():
            if len(cells) != 3 or not cells[1].isdecimal():
                raise InputError(where, f"'{line.strip()}'", "Run, target and deviation stand in each line")
            rows.append((int(cells[0]), int(cells[1]), _number(where, cells[2])))
            lines.append(number)
    return keys, targets, rows, lines


def _number(where: str, word: str) -> float:
    try:
        return float(word.replace(",", "."))
    except ValueError as error:
        raise InputError(where, f"'{word}' is not a number", "Give the file as the laser software wrote it") from error


def _bidirectional(runs: np.ndarray, targets: np.ndarray) -> bool:
    """Whether even runs take the targets in the other order."""
    even = [targets[runs == r] for r in np.unique(runs) if r % 2 == 0]
    return bool(even) and all(len(t) > 1 and t[-1] < t[0] for t in even)
