"""M and gaps in other axes: what least squares need of them is the same as in the axes of the reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine import Joint
from errormodel.machine_file import read_machine
from errormodel.turned_design import Gap, axes_of, turned_kernel

MACHINES = Path(__file__).resolve().parents[2] / "machines"
# rotary joints before the axes that are taken with all of the machine's parameters
AXES = {
    "vertical_three_axis": 0, "five_axis_table_quill": 1, "fork_head_five_axis": 0, "trunnion_five_axis": 2,
    "six_axis_arm": 3,
}  # fmt: skip


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("gap", ["nominal", "actual", "given"])
def test_columns_and_gap_are_turned_alike(name: str, gap: Gap) -> None:
    chain = Chain(read_machine(MACHINES / f"{name}.yaml"))
    assert axes_of(chain, chain.ids) == AXES[name]
    rng, n = np.random.default_rng(1), 7
    joints = {e.name: e for e in chain.machine.elements if isinstance(e, Joint)}
    rows = [rng.uniform(*joints[c].travel, n) if c in joints else rng.normal(0, 50, n) for c in chain.channels]
    p = rng.normal(0, 1e-5, len(chain.ids))
    measured = rng.normal(0, 500, (3, n))
    parts = turned_kernel(chain, gap, chain.ids, {})([*rows, *measured], p).reshape(-1, 3, n)
    plain = chain.kernel("design", chain.ids, None, (0, 1, 2))(rows, p).reshape(-1, 3, n)
    known = {
        "nominal": lambda: measured - chain.kernel("nominal", (), None, (0, 1, 2))(rows, p),
        "actual": lambda: measured - chain.kernel("actual", (), None, (0, 1, 2))(rows, p),
        "given": lambda: measured,
    }[gap]()
    whole = np.concatenate([plain, known[None]])
    sizes = np.sqrt(np.einsum("icn,icn->in", whole, whole)) + 1e-9
    found, wanted = (np.einsum("icn,jcn->nij", a / sizes[:, None], a / sizes[:, None]) for a in (parts, whole))
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_table_s_angle_leaves_most_columns() -> None:
    """Behind the rotary table, most columns are free of its sine and cosine."""
    chain = Chain(read_machine(MACHINES / "five_axis_table_quill.yaml"))
    turned = turned_kernel(chain, "nominal", chain.ids, {})
    plain = chain.kernel("design", chain.ids, None, (0, 1, 2))
    assert turned.n_functions - 3 < 0.8 * plain.n_functions
    assert axes_of(chain, chain.frame_ids) == 0
