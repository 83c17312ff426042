"""Functions of the path of a joint, against what they are, said row by row."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.arrays import Array
from identification.diagnosis.results.recorded_functions import _play, _recent, _relay, _turned


def paths() -> list[Array]:
    rng = np.random.default_rng(4)
    return [rng.normal(size=300), np.round(2 * rng.normal(size=300)), np.array([1.0, 1.0, 2.0]), np.array([3.0])]


@pytest.mark.parametrize("q", paths())
def test_path_functions_follow_the_rows_one_by_one(q: Array) -> None:
    turned, recent, play, relay = [q[0]], [], [], []
    mean = at = q[0]
    state, (low, high) = 0.0, np.quantile(q, [0.3, 0.7])
    for k, x in enumerate(q):
        if k:
            back = k > 1 and (q[k] - q[k - 1]) * (q[k - 1] - q[k - 2]) < 0
            turned.append(q[k - 1] if back else turned[-1])
        recent.append(mean)
        mean = 0.7 * mean + 0.3 * x
        at = min(max(at, x - 0.4), x + 0.4)
        play.append(at)
        state = 1.0 if x > high else -1.0 if x < low else state
        relay.append(state)
    np.testing.assert_array_equal(_turned(q), turned)
    np.testing.assert_allclose(_recent(q), recent, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(_play(q, 0.4), play)
    np.testing.assert_array_equal(_relay(q, 0.3), relay)
