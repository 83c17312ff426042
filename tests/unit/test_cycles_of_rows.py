"""What takes turns from row to row, as nests or styli used in turn, is left over, and is said."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.results.residual_dependence import dependence_of
from tests.helpers.chains import Array
from tests.helpers.linear_models import NOISES, ROWS, linear, nothing


@pytest.mark.parametrize("every", [2, 3, 4])
@pytest.mark.parametrize("noise", ["white", "correlated"])
def test_what_repeats_after_some_rows_is_seen(every: int, noise: str) -> None:
    def error(columns: dict[str, Array]) -> Array:
        return np.where(np.arange(ROWS) % every == 1, 2.0, 0.0)

    rng = np.random.default_rng(11)
    found = dependence_of(linear(error, NOISES[noise](rng), rng), 1.0)
    assert found is not None
    (channel,) = found.channels
    assert channel in ("cycle(2)", "cycle(4)") if every == 2 else channel == f"cycle({every})"
    assert f"which of every {channel[6]} rows it is" in found.statement
    assert "takes turns from row to row" in found.next_measurement


@pytest.mark.parametrize("noise", NOISES)
def test_noise_takes_no_turns(noise: str) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        found = dependence_of(linear(nothing, NOISES[noise](rng), rng), 1.0)
        assert found is None or not any(c.startswith("cycle") for c in found.channels)
