"""LinuxCNC: screw compensation of each joint by ``COMP_FILE``, types 0 and 1, alone or with squareness by matrixkins.

Three numbers per line, positions in machine units: type 0 gives the actual position of the joint, going up and going
down; type 1 gives the trim. At most 256 lines per joint and no comments: the loader stops at any other line without a
message. The motor is commanded to position plus trim; interpolation is linear, and end values hold.

The kinematics ``matrixkins`` take the positions of the first three joints from those of X, Y and Z by a matrix, with
squareness off its diagonal. Screw files act on the joints, after it.

Source: LinuxCNC's documentation of the INI file, and its code (``usrmotintf.cc``, ``control.c``, ``matrixkins.comp``);
where the two examples of the documentation disagree the code was followed.
"""

from __future__ import annotations

import re
from itertools import permutations
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers import instead
from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import RS274, Dialect
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_increasing, check_points, merged, split
from errormodel.controllers.text import Comment, Files, Lines
from errormodel.exceptions import InputError

MATRIX = re.compile(r"^setp matrixkins\.C_([xyz])([xyz]) (\S+)$", re.MULTILINE)
MATRIX_DIGITS = 10  # behind the point, of a coefficient: 0.1 nm at a metre


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
            data = lines.rows(0, 3)
            output = self.numbered(setup, int(number))
            up, down = (self._inward(data[:, 0], data[:, k]) for k in (1, 2))
            out += split(output, output, tuple(data[:, 0].tolist()), up, down)
            check_increasing(out[-1].term)
        if not out:
            raise InputError("compensation.ini", "no COMP_FILE of any joint", "Give the whole folder")
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "the files are in mm and degrees: [TRAJ] LINEAR_UNITS must be mm (where it is inch, do not load them)",
            "copy the .comp files beside the INI file and the lines of compensation.ini into its [JOINT_n] sections",
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


class LinuxCncMatrix(LinuxCnc1):
    """Squareness by the kinematics ``matrixkins``, and files of type 1 for the rest."""

    name: ClassVar[str] = "linuxcnc-matrix"
    title: ClassVar[str] = "LinuxCNC matrixkins (squareness) and COMP_FILE_TYPE = 1 (trims)"
    source: ClassVar[str] = f"{LinuxCnc1.source}, src/hal/components/matrixkins.comp"
    needs: ClassVar[str] = (
        "LinuxCNC in mm whose version has matrixkins (2.9, not all packages of it) and whose kinematics were trivkins; "
        "X, Y and Z are the joints 0, 1 and 2; a restart"
    )
    back: ClassVar[str] = (
        "KINEMATICS = trivkins as before, without matrix.hal; take COMP_FILE and COMP_FILE_TYPE out of the INI file, "
        "put BACKLASH back, restart and home"
    )
    describes: ClassVar[bool] = False  # matrixkins knows no rotary axes

    def suits(self, setup: Setup) -> None:
        super().suits(setup)
        if not {*"XYZ"} <= {*setup.linear} or [self.number(setup, n) for n in "XYZ"] != [0, 1, 2]:
            found = f"corrections by {', '.join(setup.movers)}; matrixkins wants linear axes X, Y, Z as joints 0, 1, 2"
            raise InputError(f"--controller {self.name}", found, f"Use --controller {LinuxCnc1.name} or {instead()}")

    def terms(self, setup: Setup) -> list[Term]:
        self.suits(setup)
        square = [Term(a, (), (), factor=b) for a, b in permutations("XYZ", 2) if b in setup.moving]
        return [*super().terms(setup), *square]

    def emulate(
        self, tables: Tables, setup: Setup, q: Array, direction: Array | None = None, longer: Array | None = None
    ) -> Array:
        square = tuple(t for t in tables if not t.term.inputs)
        screws = tuple(t for t in tables if t.term.inputs)
        moved = super().emulate(square, setup, q)
        joints = q.copy()
        joints[:, [setup.place(m) for m in setup.movers]] += moved
        return moved + super().emulate(screws, setup, joints, direction)

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        files = super().write(tuple(t for t in tables if t.term.inputs), setup)
        values = {t.term.output + t.term.factor: float(t.values) / 1000 for t in tables if not t.term.inputs}
        lines = header(self, setup, "after the lines that load kinematics and motion controller; power off")
        for a in "XYZ":
            for b in "XYZ":
                value = 1.0 if a == b else values.get(a + b, 0.0) + 0.0
                lines.append(f"setp matrixkins.C_{a.lower()}{b.lower()} {value:.{MATRIX_DIGITS}f}")
        return {**files, "matrix.hal": "\n".join(lines) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        found = {a.upper() + b.upper(): v for a, b, v in MATRIX.findall(files.get("matrix.hal", ""))}
        try:
            values = {k: float(v) for k, v in found.items()}
        except ValueError as error:
            raise InputError("matrix.hal", f"a coefficient that is no number ({error})", "Write it again") from error
        if len(values) != 9 or any(values[a + a] != 1.0 for a in "XYZ"):
            raise InputError("matrix.hal", "not nine coefficients with 1 on the diagonal", "Give the whole folder")
        square = [
            Table(Term(k[0], (), (), factor=k[1]), np.array(1000 * v))
            for k, v in values.items()
            if k[0] != k[1] and k[1] in setup.moving
        ]
        return (*super().read(files, setup), *square)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "[KINS] KINEMATICS = matrixkins in place of trivkins, and HALFILE = matrix.hal in [HAL], after the file "
            "that loads the motion controller; where a matrix acted during the survey, this one is to be added to it",
            "limits of joints ([JOINT_n]) need room beyond those of the axes ([AXIS_L]) by the corrections",
            *super().checklist(setup),
            "halcmd show param matrixkins must show the coefficients of matrix.hal before the machine is switched on",
        ]
