"""LinuxCNC's stand-alone interpreter as a second opinion on programmes: ``rs274`` of the package linuxcnc-uspace."""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from tests.helpers.gcode_machine import Event, execute
from tests.helpers.gcode_programmes import OFFSETS
from tests.helpers.gcode_trial import READING, SETUP, TARGET, smooth, written

CALL = re.compile(r"\s([A-Z_0-9]+)\(([^)]*)\)")
INCH = 25.4  # without an INI file its machine is one of inches
G5X = {"G54": 5220, "G57": 5280}
# Other units with a tool's length in force, and then G53: the stand-alone interpreter takes the length in the units of
# before (saicanon.cc), the controller's own converts it (emccanon.cc): such programmes are not compared.
HANDED_BACK = re.compile(r"G43.*^G2[01]\b.*G53", re.DOTALL | re.MULTILINE)


def agree(seed: int, program: Path) -> int:
    """How many motions of a programme and of the one that was made from it are the same to LinuxCNC and to us."""
    text, _ = written(seed)
    if HANDED_BACK.search(text):
        return 0
    sent = TARGET.rewrite("a.nc", text, SETUP, smooth, READING).text
    count = 0
    for version in (text, sent):
        ours = [e for e in execute(version, OFFSETS, False, True) if e.what != "word"]
        theirs = motions(version, program)
        assert len(ours) == len(theirs), (seed, len(ours), len(theirs))
        for a, (kind, end, inch) in zip(ours, theirs, strict=True):
            known = np.isfinite(a.end)
            assert kind == kind_of(a), (seed, a, kind)
            assert np.abs(a.end - end)[known].max() < (0.003 if inch else 0.00011), (seed, a, end)
        count += len(ours)
    return count


def kind_of(event: Event) -> str:
    return "STRAIGHT_TRAVERSE" if event.what == "rapid" else "ARC_FEED" if event.turn else "STRAIGHT_FEED"


def motions(text: str, program: Path) -> list[tuple[str, np.ndarray, bool]]:
    """Motions with their ends in mm on the axes, as LinuxCNC's canonical commands say them."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        lines = [f"{n}\t0.0" for n in (5161, 5162, 5163, 5181, 5182, 5183, 5211, 5212, 5213)]
        lines.append("5220\t1")
        for k in range(9):
            stated = next((OFFSETS[g] for g, n in G5X.items() if n == 5220 + 20 * k), {})
            lines += [f"{5221 + 20 * k + j}\t{stated.get(a, 0.0) / INCH:.12f}" for j, a in enumerate("XYZ")]
        (place / "rs.var").write_text("\n".join(sorted(lines)) + "\n")
        (place / "tool.tbl").write_text(f"T3 P3 Z{OFFSETS['H3']['Z'] / INCH:.12f} D1\nT4 P4 Z0 D1\n")
        (place / "a.ngc").write_text(text)
        command = [str(program), "-g", "-v", str(place / "rs.var"), "-t", str(place / "tool.tbl"), str(place / "a.ngc")]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    out, unit, origin, tool, plane = [], 1.0, np.zeros(3), np.zeros(3), "XY"
    for name, arguments in CALL.findall(done.stdout):
        values = arguments.replace(",", " ").split()
        if name == "USE_LENGTH_UNITS":
            unit = 25.4 if "INCHES" in arguments else 1.0
        elif name == "SET_G5X_OFFSET":
            origin = unit * np.array([float(v) for v in values[1:4]])
        elif name == "USE_TOOL_LENGTH_OFFSET":
            tool = unit * np.array([float(v) for v in values[:3]])
        elif name == "SELECT_PLANE":
            plane = next(p for p in ("XY", "YZ", "XZ") if p in arguments)
        elif name.startswith("STRAIGHT"):
            out.append((name, unit * np.array([float(v) for v in values[:3]]) + origin + tool, unit > 1))
        elif name == "ARC_FEED":
            first, second, axial = (float(values[k]) for k in (0, 1, 5))
            end = {"XY": (first, second, axial), "YZ": (axial, first, second), "XZ": (second, axial, first)}[plane]
            out.append((name, unit * np.array(end) + origin + tool, unit > 1))
    assert done.stdout, done.stderr
    return out
