"""Cubic B-splines: the same of arrays, of which four differ from zero at each place, and of symbols."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.effects.ops import Value
from errormodel.effects.shared import closed_splines, splines


@pytest.mark.long
@pytest.mark.parametrize(("curve", "least"), [(splines, 2), (closed_splines, 5)])
@given(data=st.data())
def test_arrays_and_symbols_have_one_value(curve: object, least: int, data: st.DataObject) -> None:
    assert callable(curve)
    n = data.draw(st.integers(least, 40))
    at = np.array(data.draw(st.lists(st.floats(-7, 7), min_size=1, max_size=9)))
    x = ca.SX.sym("x")
    symbolic = ca.Function("curve", [x], list(curve(x, n)))
    values = np.array(list(curve(at, n)))
    np.testing.assert_allclose(values, np.column_stack([_numbers(symbolic(v)) for v in at]), atol=1e-12)
    np.testing.assert_allclose(values.sum(axis=0), 1.0)
    assert ((values > 1e-15).sum(axis=0) <= 4).all()


def _numbers(values: Value) -> Value:
    return [float(v) for v in values]


def test_a_place_that_is_not_known_has_no_value() -> None:
    values = np.array(list(splines(np.array([0.3, np.nan]), 4)))
    assert np.isfinite(values[:, 0]).all()
    assert np.isnan(values[:, 1]).all()
