"""Sensors that hang in the air show its gradient, and so does the line of sight; those of the machine seldom do."""

from __future__ import annotations

from typing import Any

import pytest

from tests.helpers.findings import made

ANY_SCENE: Any = None


@pytest.mark.parametrize(
    ("sensor", "minus", "free"),
    [
        ("T_air_hi", "T_air_lo", True),
        ("T_ceiling", "T_floor", True),
        ("T_Raum_oben", "T_Luft2", True),
        ("T_air", None, False),  # one alone is the mean of the air, which warms the machine as well
        ("T_air", "T_bed", False),
        ("T_hallmark", "T_stairs", False),  # words that only begin or end so
        (None, None, True),
    ],
)
def test_two_sensors_in_the_air_are_there_for_its_gradient(sensor: str | None, minus: str | None, free: bool) -> None:
    options = {k: v for k, v in {"sensor": sensor, "minus": minus}.items() if v}
    assert (made("refraction", motion="dz", **options).cost(ANY_SCENE) == 0.0) == free
