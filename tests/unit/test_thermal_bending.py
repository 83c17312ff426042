"""A beam bent by a temperature difference: supported at both ends of its travel, or held at one."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from errormodel.effects.base import EffectTerm
from errormodel.machine_file import read_machine
from tests.helpers.findings import made

MACHINE = read_machine("vertical_three_axis")
HELD: tuple[Literal["low", "high"] | None, ...] = (None, "low", "high")


def bow(held: str | None, warm: float = 1.0) -> tuple[EffectTerm, np.ndarray]:
    """The first parameter's motion along the travel of Z, and the positions."""
    q = np.linspace(*next(j for j in MACHINE.joints if j.name == "Z").travel, 201)
    effect = made("thermal-bending", joint="Z", motion="dx", sensor="T_front", minus="T_back", held=held)
    values = {"Z": q, "T_front": np.full_like(q, 20 + warm), "T_back": np.full_like(q, 20.0)}
    return effect.terms(values.__getitem__, MACHINE)[0], q


@pytest.mark.parametrize("held", HELD)
def test_the_curvature_is_one_and_the_angle_is_the_slope(held: str | None) -> None:
    term, q = bow(held)
    deflection, angle = np.asarray(term.motion["dx"]), np.asarray(term.motion["eb"])
    np.testing.assert_allclose(np.gradient(np.gradient(deflection, q), q)[3:-3], -1.0, rtol=1e-6)
    np.testing.assert_allclose(np.gradient(deflection, q)[1:-1], angle[1:-1], rtol=1e-6, atol=1e-6)


def test_it_rests_where_it_is_held() -> None:
    supported, low, high = (np.asarray(bow(held)[0].motion["dx"]) for held in HELD)
    assert supported[0] == supported[-1] == 0
    for deflection, end in ((low, 0), (high, -1)):
        assert deflection[end] == 0
        assert np.argmax(np.abs(deflection)) == (200 if end == 0 else 0)


def test_a_cantilever_is_a_supported_beam_that_is_turned() -> None:
    """Their difference is a rotation, which no geometry holds, since it follows the temperature."""
    supported, low = (np.asarray(bow(held)[0].motion["dx"]) for held in HELD[:2])
    q = bow(None)[1]
    tilt = np.polynomial.Polynomial.fit(q, supported - low, 1)
    assert tilt(q) == pytest.approx(supported - low, abs=1e-6)


def test_no_temperature_difference_bends_nothing() -> None:
    assert not np.any(bow("low", 0.0)[0].motion["dx"])
