"""Kernels of expressions that no chain has: every operation, signs, switches, infinities, blocks and buffers."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.chain import Chain
from errormodel.kernel import BLOCK, Kernel, as_rows
from errormodel.schema import read_machine
from tests.chains import Array, errors, poses

X, P = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, np.inf, -np.inf, np.nan, 1e-300, -1e300]


def evaluated(outputs: ca.SX, x: list[Array], p: Array) -> Array:
    n = len(x[0])
    function = ca.Function("f", [X, P], [ca.densify(ca.vec(outputs))])
    return function.map(n)(np.array(x), ca.repmat(ca.DM(p), 1, n)).full()


def assert_same(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-300)
