"""The sign of every controller's tables, in its own file: written and read with one wrong sign would still agree."""

from __future__ import annotations

import re

import numpy as np
import pytest

from errormodel.controllers import registry, target
from errormodel.controllers.base import Controller
from errormodel.controllers.tables import Table, Tables, Term
from tests.helpers.setups import plain_setup

TABLED = sorted(n for n, kind in registry().items() if issubclass(kind, Controller))
OUT = 0.010  # mm
NODES = (0.0, 200.0, 400.0), (0.0, 150.0, 300.0)
LATTICE = (0.0, 400.0), (0.0, 300.0), (-250.0, -50.0)
END = [400.0, 300.0, -50.0]  # there the axis stands OUT too far

# Where the file has the value at END, and what it is there: errors (actual minus nominal) are positive, corrections
# negative; in the unit of the file.
FILES = {
    "linuxcnc-type0": (r"^400\.0+ (\S+)", 400 + OUT),  # where it really was
    "linuxcnc-type1": (r"^400\.0+ (\S+)", -OUT),  # the trim takes it back
    "linuxcnc-matrix": (r"^setp matrixkins.C_xy (\S+)", -OUT / END[1]),  # the joint of X gets that much of Y
    "linuxcnc-3d": (r"^(-0\.010+)$", -OUT),  # a correction, added to what goes to the motor
    "siemens-lec": (r"COMP\[0,1,X1\]=(\S+)", OUT),  # a positive value moves the axis in minus direction
    "siemens-cec": (r"CEC\[0,1\]=(\S+)", OUT),
    "heidenhain": (r"^1 +400\.0+ +(\S+)", OUT),
    "twincat-nc": (r"Position := 400, Compensation := ([-\d.]+)", -OUT),
    "aerotech-1d": (r"^(-?10\.0+)$", -1000 * OUT),
    "aerotech-2d": (r"0\.00000 0\.00000  (-?10\.0+) ", -1000 * OUT),
    "isg": (r"^400 (\S+)", OUT),
    "etalon": (r"^400 (\S+)", OUT),
    "csv": (r"^400,(\S+)", -OUT),
    "pmac": (r"^(-?\d+) 0 0$", -160),  # sixteenths of a count of 1 um
    "fanuc-pitch": (r"N1\d{4}P(-?5)$", -5),  # um, from the point before
    "fanuc-3d": (r"N11021P(-?\d+)", -1000 * OUT),  # x, y and z of eight points: x of the last
    "duet": (r"(-?0\.010)$", -OUT),  # added to Z
    "klipper": (r"(-?0\.010000)$", -OUT),
    "marlin": (r"^M852 I(\S+)", OUT / END[1]),  # the firmware takes Y times I off X
}


def tables_for(name: str) -> Tables:
    """Tables by which X, or the height, is corrected by -OUT at END and by nothing elsewhere."""
    if name in ("isg", "etalon"):  # tables of errors
        return (Table(Term("EXX", ("X",), ((0.0, 400.0),)), np.array([0.0, OUT])),)
    if name == "fanuc-pitch":  # an increment holds 7 um
        return (Table(Term("X", ("X",), (NODES[0],)), np.array([0.0, -OUT / 2, -OUT])),)
    if name in ("duet", "klipper"):
        return (Table(Term("Z", ("X", "Y"), NODES), np.pad([[-OUT]], ((2, 0), (2, 0)))),)
    if name in ("marlin", "linuxcnc-matrix"):
        return (Table(Term("X", (), (), factor="Y"), np.array(-1000 * OUT / END[1])),)
    if name == "aerotech-2d":
        return (Table(Term("X", ("X", "Y"), LATTICE[:2]), np.pad([[-OUT]], ((1, 0), (1, 0)))),)
    if name == "fanuc-3d":
        corner = np.pad([[[-OUT]]], ((1, 0), (1, 0), (1, 0)))
        return tuple(Table(Term(o, ("X", "Y", "Z"), LATTICE), corner * (o == "X")) for o in "XYZ")
    return (Table(Term("X", ("X",), ((0.0, 400.0),)), np.array([0.0, -OUT])),)


def test_every_format_of_tables_has_its_sign_here() -> None:
    assert set(FILES) == set(TABLED)


@pytest.mark.parametrize("name", FILES)
def test_an_axis_that_goes_too_far_has_the_sign_its_format_wants(name: str) -> None:
    """At END the axis stands 10 um too far: the correction is -10 um, and the file says so in its own way."""
    pattern, wanted = FILES[name]
    setup, tables, controller = plain_setup(), tables_for(name), target(name)
    assert isinstance(controller, Controller)
    text = "\n".join(controller.write(tables, setup).values())
    values = [float(v) for v in re.findall(pattern, text, re.MULTILINE)]
    assert values, text
    assert values == pytest.approx([wanted] * len(values), abs=1e-6)
    moved = controller.emulate(tables, setup, np.array([END]))
    expected = [0.0, 0.0, -OUT] if name in ("duet", "klipper") else [-OUT, 0.0, 0.0]
    np.testing.assert_allclose(moved, [expected], atol=1e-9)
