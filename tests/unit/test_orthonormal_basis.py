"""The basis of the geometry holds what its columns span and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification.estimation.orthonormal_basis import MANY, orthonormal_basis


@given(seed=st.integers(0, 10_000), rank=st.integers(1, 8), dependent=st.integers(0, 5))
def test_dependent_columns_add_no_direction(seed: int, rank: int, dependent: int) -> None:
    rng = np.random.default_rng(seed)
    independent = rng.normal(size=(30, rank))
    columns = np.hstack([independent, independent @ rng.normal(size=(rank, dependent))])
    columns = columns[:, rng.permutation(columns.shape[1])]
    columns /= np.linalg.norm(columns, axis=0)
    basis = orthonormal_basis(columns)
    assert basis.shape == (30, rank)
    np.testing.assert_allclose(basis.T @ basis, np.eye(rank), atol=1e-12)
    np.testing.assert_allclose(basis @ (basis.T @ columns), columns, atol=1e-9)


def test_no_columns() -> None:
    assert orthonormal_basis(np.zeros((5, 0))).shape == (5, 0)


@pytest.mark.parametrize(("apart", "rank"), [(1e-3, MANY + 1), (1e-7, MANY + 1), (1e-12, MANY)])
def test_many_columns_are_as_orthonormal_however_alike_two_are(apart: float, rank: int) -> None:
    """Products of columns hide less than a millionth of one: then they are not used."""
    columns = np.linalg.qr(np.random.default_rng(0).normal(size=(200, MANY + 1)))[0]
    columns[:, 1] = np.sqrt(1 - apart**2) * columns[:, 0] + apart * columns[:, 1]
    basis = orthonormal_basis(columns)
    assert basis.shape == (200, rank)
    np.testing.assert_allclose(basis.T @ basis, np.eye(rank), atol=1e-13)
    np.testing.assert_allclose(basis @ (basis.T @ columns), columns, atol=1e-10)
