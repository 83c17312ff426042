"""What findings recommend to measure, where a survey has some of it."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.effects.base import Effect
from identification.diagnosis.results.statements import next_measurement
from tests.helpers.findings import made


@pytest.mark.parametrize(
    ("effect", "channel", "word"),
    [
        (made("joint-compliance", joint="B", payload=True), "load", "payloads"),
        (made("backlash", joint="X"), "feed", "feeds"),
        (made("servo-lag", joint="X"), "feed", "feeds"),
    ],
)
def test_no_measurement_is_asked_for_that_the_survey_has(effect: Effect, channel: str, word: str) -> None:
    """Two payloads had been asked for after a survey under 0 and 14 kg."""
    assert word in next_measurement(effect, None, {})
    assert word in next_measurement(effect, None, {channel: np.full(9, 7.0)})
    varied = {channel: np.repeat([0.0, 7.0, 14.0], 3)}
    assert word not in next_measurement(effect, None, varied)
    assert word not in next_measurement(effect, made("lost-motion", joint="X"), varied)
