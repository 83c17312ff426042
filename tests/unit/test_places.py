"""Probability of the place of a finding, given its name."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.effects import make, registry
from errormodel.machine import EffectSpec
from identification.diagnosis.results.findings import Alternative
from identification.diagnosis.results.places import place_probabilities, sentence_of_places, with_places


@given(st.lists(st.tuples(st.sampled_from(["bed", "column", "X", "frame"]), st.floats(-40, 5)), max_size=6))
def test_places_share_one_probability(found: list[tuple[str, float]]) -> None:
    """They add up to 1, none is likelier than the chosen one, and each alternative has that of its place."""
    others = [Alternative("warm-up", place, factor, False) for place, factor in found]
    others.append(Alternative("beam-sag", "Z", 3.0, False))
    places = place_probabilities("warm-up", "bed", others)
    assert sum(places.values()) == pytest.approx(1)
    assert max(places.values()) == places["bed"]
    assert next(iter(places)) == "bed"
    warm = make(EffectSpec("warm-up", {"element": "bed", "motion": "dx", "tau": 900.0}))
    *own, sag = with_places(others, warm, ["dx"], places)
    assert [a.place_probability for a in own] == [places[place] for place, _ in found]
    assert sag.place_probability is None


@pytest.mark.parametrize("effect", ["scale-ppm", "refraction", "tracker-drift"])
def test_an_instrument_is_the_measuring_frame(effect: str) -> None:
    """Whoever looks for the effect at the instrument finds it there, as likely."""
    (same,) = with_places([], make(EffectSpec(effect, registry()[effect].example)), ["dx"], {"frame": 1.0})
    assert (same.effect, same.where, same.separable) == (effect, "instrument", False)
    assert (same.log10_bayes_factor, same.place_probability, same.probability) == (0.0, 1.0, None)


def test_what_is_said_of_places() -> None:
    """The likely ones, the likeliest first; nothing where none is."""
    said = sentence_of_places({"K3": 0.5, "frame": 0.2, "K4": 0.28, "K5": 0.02})
    assert said == (
        "Its place may also be K4 (0.28) or the measuring frame (0.20): that it is K3 has a probability of 0.50."
    )
    assert not sentence_of_places({"K3": 0.99, "K4": 0.01})
