"""LinuxCNC: screw compensation of each joint by ``COMP_FILE``, types 0 and 1.

Three numbers per line, positions in machine units: type 0 gives the actual position of the joint, going up and going
down; type 1 gives the trim. At most 256 lines per joint and no comments: the loader stops at any other line without a
message. The motor is commanded to position plus trim; interpolation is linear, and end values hold.

Source: LinuxCNC's documentation of the INI file, and its code (``usrmotintf.cc``, ``control.c``); where the two
examples of the documentation disagree the code was followed.
"""

from __future__ import annotations

import re
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import RS274, Dialect
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables, Term, check_increasing, check_points, merged, split
from errormodel.controllers.text import Comment, Files, Lines
from errormodel.exceptions import InputError


class LinuxCnc1(Controller):
    """Files of type 1: trims."""

    name: ClassVar[str] = "linuxcnc-type1"
    title: ClassVar[str] = "LinuxCNC COMP_FILE_TYPE = 1 (trims)"
    source: ClassVar[str] = "LinuxCNC docs/src/config/ini-config.adoc, src/emc/usr_intf/usrmotintf.cc"
    needs: ClassVar[str] = "LinuxCNC in mm, with joints that are the axes themselves (trivkins) and a restart"
    back: ClassVar[str] = "take COMP_FILE and COMP_FILE_TYPE out of the INI file, put BACKLASH back, restart and home"
    bidirectional: ClassVar[bool] = True
    comment: ClassVar[Comment | None] = Comment("# ")
    sign_known: ClassVar[bool] = True
    backlash_parameter: ClassVar[str] = "BACKLASH in [{axis}]"
    backlash_beside: ClassVar[str] = (
        "{} is ignored beside a COMP_FILE; if it was not 0 during the survey, set it to 0 and measure again first"
    )
    first_number: ClassVar[int | None] = 0
    number_form: ClassVar[str] = "JOINT_{}"
    dialect: ClassVar[Dialect | None] = RS274
    most_points: ClassVar[int] = 256
    kind: ClassVar[int] = 1

    def terms(self, setup: Setup) -> list[Term]:
        return self.curves(setup, [(m, m) for m in setup.linear if m in setup.moving])

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        files, ini, comment = {}, header(self, setup), self.comment or Comment("# ")
        for (output, _, _), sides in merged(tables).items():
            term = next(iter(sides.values())).term
            check_points(term, self.most_points)
            check_increasing(term)
            both = sides.get(0)
            up, down = (both, both) if both else (sides[1], sides[-1])
            joint = self.number(setup, output)
            file = f"joint_{joint}_{output}.comp"
            rows = [
                f"{x:.6f} {self._outward(x, u):.6f} {self._outward(x, d):.6f}"
                for x, u, d in zip(term.grids[0], up.values, down.values, strict=True)
            ]
            files[file] = "\n".join(rows) + "\n"
            ini += [
                comment.line(f"axis {output}"),
                f"[JOINT_{joint}]",
                f"COMP_FILE = {file}",
                f"COMP_FILE_TYPE = {self.kind}",
            ]
        return {**files, "compensation.ini": "\n".join(ini) + "\n"}

    def _outward(self, position: float, correction: float) -> float:
        return correction

    def _inward(self, position: Array, value: Array) -> Array:
        return value

    def read(self, files: Files, setup: Setup) -> Tables:
        out = []
        for number, file in re.findall(
            r"^\[JOINT_(\d+)\]\s*COMP_FILE\s*=\s*(\S+)", files.get("compensation.ini", ""), re.MULTILINE
        ):
            if file not in files:
                raise InputError("compensation.ini", f"COMP_FILE {file}, which is not there", "Give the whole folder")
            lines = Lines.of(file, files[file])
            data = np.array([lines.numbers(k, s, 3) for k, s in lines.lines]).reshape(-1, 3)
            output = self.numbered(setup, int(number))
            up, down = (self._inward(data[:, 0], data[:, k]) for k in (1, 2))
            out += split(output, output, tuple(data[:, 0].tolist()), up, down)
            check_increasing(out[-1].term)
        if not out:
            raise InputError("compensation.ini", "no COMP_FILE of any joint", "Give the whole folder")
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "copy the .comp files beside the INI file and the lines of compensation.ini into its [JOINT_n] sections",
            "the files are in mm and degrees: [TRAJ] LINEAR_UNITS must be mm (where it is inch, do not load them)",
            "compare the joint numbers above with those of the axes on this machine ([TRAJ] COORDINATES, [KINS])",
            "BACKLASH of these joints is ignored where a COMP_FILE is given. Where it was not 0 during the survey, the "
            "play comes back with these files: set BACKLASH to 0, measure again, and have errormodel diagnose find it",
            "restart LinuxCNC (a reload in the same session appends to the table), home, then check with an indicator",
        ]


class LinuxCnc0(LinuxCnc1):
    """Files of type 0: actual positions."""

    name: ClassVar[str] = "linuxcnc-type0"
    title: ClassVar[str] = "LinuxCNC COMP_FILE_TYPE = 0 (actual positions)"
    kind: ClassVar[int] = 0

    def _outward(self, position: float, correction: float) -> float:
        return position - correction

    def _inward(self, position: Array, value: Array) -> Array:
        return position - value
