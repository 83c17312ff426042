"""A scale of the instrument that follows a temperature as much as scales of machines do is said to look like these."""

from __future__ import annotations

import pytest

from errormodel.effects.scale_ppm import ScalePpm


@pytest.mark.parametrize(("coefficient", "said"), [(0.95e-6, False), (-11e-6, False), (8e-6, True), (11.5e-6, True)])
def test_what_expands_like_scales(coefficient: float, said: bool) -> None:
    assert ("expand alike along all axes" in ScalePpm(sensor="T_hall").meaning_of_sign([coefficient])) is said
    assert not ScalePpm().meaning_of_sign([coefficient])
