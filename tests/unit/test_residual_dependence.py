"""Whether what is left depends on anything recorded: quiet in noise of any kind, and seen where it does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.residual_dependence import dependence_of
from tests.helpers.chains import Array
from tests.helpers.linear_models import NOISES, ROWS, linear, nothing
from tests.helpers.nightly import first_of


@pytest.mark.parametrize("seeds", first_of([range(20), range(20, 40)]), ids=str)
@pytest.mark.parametrize("kind", first_of(NOISES))
def test_noise_of_any_kind_is_independent(kind: str, seeds: range) -> None:
    for seed in seeds:
        rng = np.random.default_rng(seed)
        noise = NOISES[kind](rng)
        assert dependence_of(linear(nothing, noise, rng), 1.0) is None, seed


def switched(columns: dict[str, Array]) -> Array:
    """A state that no channel shows changes the slope of X: for the test, twice during the survey."""
    state = (np.arange(ROWS) // 80) % 2
    return np.asarray(4.0 * state * columns["X"])


@pytest.mark.parametrize(
    ("error", "channels"),
    [
        (lambda c: 1.2 * np.sign(c["X"] * c["Y"]), {"X", "Y"}),
        (lambda c: 1.5 * np.tanh(4 * np.concatenate([[0.0], c["Y"][:-1]])), {"before(Y)"}),
        (lambda c: 1.2 * c["dir_Z"] * np.cos(3 * c["Y"]), {"dir_Z", "Y"}),
        (switched, {"X", "time"}),
    ],
)
def test_what_no_effect_describes_is_seen(error: Callable[[dict[str, Array]], Array], channels: set[str]) -> None:
    found = []
    for seed in range(6):
        rng = np.random.default_rng(100 + seed)
        found.append(dependence_of(linear(error, rng.normal(size=3 * ROWS), rng), 1.0))
    seen = [f for f in found if f is not None]
    assert len(seen) >= 5
    assert sum(set(f.channels) == channels for f in seen) >= 4
    best = max(seen, key=lambda f: f.size_um)
    assert best.axis == "x"
    assert 0.3 < best.size_um < 2.5  # um rms: of what is there at most all, and most of the smooth part
    assert "depends on" in best.text


def relay(columns: dict[str, Array]) -> Array:
    """A state that Y leaves behind: the side of its travel that it was last near the end of."""
    state, out = 0.0, np.zeros(ROWS)
    for k, y in enumerate(columns["Y"]):
        state = 1.0 if y > 0.4 else -1.0 if y < -0.4 else state
        out[k] = state
    return out


def wandering(columns: dict[str, Array]) -> Array:
    """A parameter that wanders as it likes, quicker than any smooth curve of the clock."""
    rng = np.random.default_rng(9)
    out = np.zeros(ROWS)
    for k in range(1, ROWS):
        out[k] = 0.8 * out[k - 1] + rng.normal(0, 0.6)
    return 3.5 * out


@pytest.mark.long
@pytest.mark.parametrize(
    ("error", "tilts", "channels", "element"),
    [
        (relay, False, {"relay(Y)", "recent(Y)", "play(Y)", "turn(Y)"}, ""),
        (lambda c: 1.3 * np.tanh(4 * np.concatenate([[0.0, 0.0], c["Y"][:-2]])), False, {"before(before(Y))"}, ""),
        (wandering, True, {"time"}, "Y"),
    ],
)
def test_memory_of_the_path_and_wandering_motions_are_seen(
    error: Callable[[dict[str, Array]], Array], tilts: bool, channels: set[str], element: str
) -> None:
    found = []
    for seed in range(6):
        rng = np.random.default_rng(200 + seed)
        found.append(dependence_of(linear(error, rng.normal(size=3 * ROWS), rng, tilts), 1.0))
    seen = [f for f in found if f is not None]
    assert len(seen) >= 5
    assert sum(set(f.channels) <= channels for f in seen) >= 4
    assert sum(f.element == element for f in seen) >= 4
    assert all(f.axis == "x" or tilts for f in seen)  # a tilt moves z as well


def test_few_rows_say_nothing() -> None:
    rng = np.random.default_rng(0)
    whole = linear(lambda c: 5 * c["X"] * c["Y"], rng.normal(size=3 * ROWS), rng)
    few = np.isin(whole.index, np.arange(20))
    some = LinearModel(
        whole.chain, whole.residual[few], whole.basis[few], whole.levers, {}, whole.index[few], whole.scene
    )
    assert dependence_of(some, 1.0) is None
