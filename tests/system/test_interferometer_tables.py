"""Tables from readings of single joints: they leave the machine where it stands at the reference point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification.compensation.compensate import compensate
from identification.compensation.result import Compensation
from tests.helpers.chains import Array
from tests.helpers.interferometer import Motion, fitted, record, screw, targets


def truth_and_tables(result: Compensation, motion: Motion) -> list[tuple[float, Array, float | None]]:
    """In each state: its temperature, what the tables leave of a motion at positions (um), and the shift ordered."""
    q, out = np.linspace(20, 580, 200), list[tuple[float, Array, float | None]]()
    for one in result.sets:
        warm = one.state.get("T_bed", 20.0)
        curve = next(t for t in one.tables if t.term.inputs)
        moved = 1e3 * np.interp(q, curve.term.grids[0], curve.values.ravel())
        shift = next((float(t.values) for t in one.tables if not t.term.inputs), None)
        out.append((warm, motion(q, q, q, warm + 0 * q) + moved, shift))
    return out


WARMING = "effects: [{effect: scale-expansion, joint: X, sensor: T_bed}]\n"


def warming(q: Array, side: Array, time: Array, bed: Array) -> Array:
    return screw(q, side, time, bed) + 0.04 * q * (bed - 20)


@pytest.mark.parametrize("warm", [0.0, 4.0])
@pytest.mark.parametrize("name", ["siemens-lec", "csv"])
def test_the_zero_of_a_laser_orders_no_shift(tmp_path: Path, warm: float, name: str):
    """Relative to where the axis stands at its first point the tables are right as they are, at any temperature."""
    rng = np.random.default_rng(5)
    table = record("X", {"dx": warming}, targets(20, 580, 11, rng), rng, warm=warm, pause=60.0)
    result = compensate(fitted(tmp_path, tmp_path / "mill.yaml", table, WARMING if warm else ""), name)
    assert len(result.sets) == (3 if warm else 1)
    for bed, left, shift in truth_and_tables(result, warming):
        assert shift is None
        assert np.abs(left - left[0]).max() < 1.0, bed
    assert not any("work offset" in line or "set zero" in line for line in result.first)
    said = " ".join(result.turned)
    assert "errors count from X=20" in said
    assert "A zero that was set there stays" in said
    for one in result.sets:
        assert one.coordinates is not None
        assert one.coordinates.untouched_um == pytest.approx(one.coordinates.left_um)
        assert one.figures[0].after.rms_um < 0.3 < 5 < one.figures[0].before.rms_um


def test_a_shift_that_one_recording_shows_is_ordered(tmp_path: Path):
    """Of an axis read from a single zero all along, the reference point is seen to move with the temperature."""
    rng = np.random.default_rng(6)

    def drifting(q: Array, side: Array, time: Array, bed: Array) -> Array:
        return screw(q, side, time, bed) + 7 * (bed - 20)

    table = record(
        "X", {"dx": drifting}, targets(20, 580, 11, rng), rng, warm=4.0, pause=60.0, columns=("time", "T_bed")
    )
    effects = "effects: [{effect: structure-drift, element: X, motion: dx, sensor: T_bed}]\n"
    result = compensate(fitted(tmp_path, tmp_path / "mill.yaml", table, effects), "siemens-lec")
    cold, middle, hot = truth_and_tables(result, drifting)
    assert middle[2] is None
    for bed, _, shift in (cold, hot):
        assert shift == pytest.approx(-7e-3 * (bed - middle[0]), abs=5e-4)
    assert sum("Add to every work offset" in line for line in result.first) == 2
