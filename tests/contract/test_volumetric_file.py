"""Files of error parameters carry all that their levers need: a kernel that knows nothing but them corrects alike."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from tests.contract.test_controller_axes import setup_of
from tests.helpers.chains import Array
from tests.helpers.setups import filled

LINEAR, ROTARY = "XYZ", "ABC"


class Kernel:
    """Errors and nominal motion from an ISG_CSV file and its list alone, by products of exponentials."""

    def __init__(self, files: dict[str, str]) -> None:
        lists = dict(re.findall(r"^(\w+) +(\S+)$", files["vol_comp_0.lis"], re.MULTILINE))
        assert lists["workpiece_axes"] == "0"
        self.chain = lists["chain"]
        self.constants: dict[str, float] = {}
        self.curves: dict[str, tuple[Array, Array]] = {}
        plain = "\n".join(s for s in files["vol_comp_0.csv"].splitlines() if not s.startswith("//"))
        for block in plain.split("#\n"):
            head, *rows = block.splitlines()
            names, data = head.split(), np.array([r.split() for r in rows], dtype=np.float64)
            if len(names[0]) > 1:
                self.constants |= dict(zip(names, data[0].tolist(), strict=True))
            else:
                self.curves |= {n: (data[:, 0], data[:, k]) for k, n in enumerate(names) if k}

    def vector(self, kind: str, axis: str) -> Array:
        default = float(kind == "V") * np.eye(3)[(LINEAR if axis in LINEAR else ROTARY).index(axis)]
        found = [self.constants.get(f"{kind}{a}{axis}") for a in LINEAR]
        return np.array([d if v is None else v for d, v in zip(default, found, strict=True)])

    def tip(self, q: dict[str, float], wrong: bool) -> Array:
        p = np.array([self.constants[f"P0{a}"] for a in LINEAR])
        for axis in reversed(self.chain):
            centre = self.vector("P", axis) if axis in ROTARY else np.zeros(3)
            if axis in ROTARY:
                turn = Rotation.from_rotvec(np.radians(q[axis]) * self.vector("V", axis))
                p = centre + turn.apply(p - centre)
            if wrong:
                e = [np.interp(q[axis], *self.curves[f"E{m}{axis}"]) for m in LINEAR + ROTARY]
                p = p + e[:3] + np.cross(e[3:], p - centre)
            if axis in LINEAR:
                p = p + q[axis] * self.vector("V", axis)
        return p

    def correction(self, q: dict[str, float]) -> Array:
        """Of X, Y and Z, mm."""
        axes = [np.array(self.tip({**q, a: q[a] + 1.0}, False)) - self.tip(q, False) for a in LINEAR]
        return -np.linalg.solve(np.array(axes).T, self.tip(q, True) - self.tip(q, False))


def small(controller: Controller, setup: Setup) -> dict[str, str]:
    """Files of random errors, small so that they add up."""
    tables = filled(controller, setup, controller.structures(setup)[0], np.random.default_rng(0), 1e-3)
    return controller.write(tables, setup)


@pytest.mark.parametrize("name", ["vertical_three_axis", "bridge_cmm", "fork_head_five_axis", "trunnion_five_axis"])
def test_a_kernel_that_knows_the_file_only_corrects_alike(name: str) -> None:
    setup, controller = setup_of(name), target("isg")
    assert isinstance(controller, Controller)
    files = small(controller, setup)
    kernel, tables = Kernel(files), controller.read(files, setup)
    low, high = (np.array([a.travel[k] for a in setup.axes]) for k in (0, 1))
    q = np.random.default_rng(1).uniform(low, high, (20, len(low)))
    told = controller.emulate(tables, setup, q)
    order = [setup.movers.index(a) for a in LINEAR]
    for place, wanted in zip(q, told[:, order], strict=True):
        found = kernel.correction(dict(zip(setup.names, place.tolist(), strict=True)))
        # second order: a rotation of some urad of another's displacement of some um
        np.testing.assert_allclose(found, wanted, atol=2e-6)


@pytest.mark.parametrize("name", ["isg", "etalon"])
def test_the_centres_of_rotary_axes_stand_in_the_file(name: str) -> None:
    controller, setup = target(name), setup_of("trunnion_five_axis")
    assert isinstance(controller, Controller)
    text = "\n".join(small(controller, setup).values())
    found = re.search(r"PZA\D*?(-?\d+)" if name == "etalon" else r"^P0X .*\bPZA\b", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    said = " ".join(controller.about((), setup))
    assert "N0X" in said
    assert "centres of A, C" in said
