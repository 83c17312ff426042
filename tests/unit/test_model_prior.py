"""Prior of a whole model: how many sensors and lags one name has."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from errormodel.effects import make
from errormodel.machine import EffectSpec
from identification.diagnosis.decisions.constants import CLEARLY
from identification.diagnosis.search import model as models
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step


@pytest.mark.parametrize(("taus", "times"), [((900.0,), 0), ((60.0, 900.0), 0), ((60.0, 300.0, 900.0, 2700.0), 2)])
def test_a_third_lag_is_clearly_less_likely(
    monkeypatch: pytest.MonkeyPatch, taus: tuple[float, ...], times: int
) -> None:
    monkeypatch.setattr(models.coloured, "evidence", lambda *_: [(0.0, 0.0)])
    linear: Any = SimpleNamespace()
    spec = {"joint": "X", "sensor": "T_scale"}
    lags = [make(EffectSpec("scale-expansion", {**spec, "tau": tau})) for tau in taus]
    steps = tuple(Step(e, 0.0, 0.0, 0.0, parent=0 if k else None) for k, e in enumerate(lags))
    assert EffectModel(linear, linear, steps).log_posterior == pytest.approx(-times * CLEARLY)


def test_further_terms_that_no_temperature_drives_are_as_likely_as_any(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models.coloured, "evidence", lambda *_: [(0.0, 0.0)])
    linear: Any = SimpleNamespace()
    wave = make(EffectSpec("pitch-cyclic", {"joint": "X", "period": 10.0}))
    steps = tuple(Step(wave, 0.0, 0.0, 0.0, parent=0 if k else None) for k in range(4))
    assert EffectModel(linear, linear, steps).log_posterior == pytest.approx(0.0)
