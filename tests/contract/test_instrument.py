"""What every instrument keeps to: words and units of its keys, covariances that are some, noise of that covariance."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import errormodel
from errormodel.instruments import instruments
from errormodel.instruments.base import Instrument
from errormodel.instruments.plain import Plain
from errormodel.machine_file import read_machine
from errormodel.simulation import simulate
from errormodel.survey import read_survey
from identification import fit
from tests.helpers.instrument_settings import settings_of

KINDS = instruments()
POINTS = np.random.default_rng(2).uniform(-800, 2500, (40, 3))
WITH_GAPS = np.where(np.random.default_rng(3).random(POINTS.shape) < 0.3, np.nan, POINTS)


@pytest.mark.parametrize("word", KINDS)
def test_says_what_it_is_and_the_unit_of_every_key(word: str) -> None:
    kind = KINDS[word]
    assert kind.__doc__
    assert get_args(kind.model_fields["type"].annotation) == (word,)
    for name, field in kind.model_fields.items():
        if name != "type":
            text = field.description or ""
            assert any(unit in text.replace(",", " ").split() for unit in ("mm", "rad", "mm/mm", "1")), name


@pytest.mark.parametrize("word", KINDS)
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_covariances_are_finite_and_noise_has_them(word: str, data: st.DataObject) -> None:
    instrument: Instrument = data.draw(settings_of(KINDS[word]))
    for points in (POINTS, WITH_GAPS):
        covariance = instrument.covariance(points)
        noise = instrument.draw_noise(points, np.random.default_rng(0))
        assert noise.shape == points.shape
        assert np.isfinite(noise).all()
        if covariance is None:
            assert not noise.any()
            continue
        assert covariance.shape == (len(points), 3, 3)
        assert np.isfinite(covariance).all()
        assert np.linalg.eigvalsh(covariance).min() > 0
    if covariance is not None:
        many = np.repeat(POINTS[:1], 4000, axis=0)
        drawn = instrument.draw_noise(many, np.random.default_rng(1))
        wanted = instrument.covariance(many)
        assert wanted is not None
        whitened = np.linalg.solve(np.linalg.cholesky(wanted[0]), drawn.T)
        np.testing.assert_allclose(np.cov(whitened), np.eye(3), atol=0.15)  # 0.15: six standard errors of 4000


@pytest.mark.parametrize("word", KINDS)
@settings(max_examples=5, deadline=None)
@given(data=st.data())
def test_a_survey_file_keeps_it(word: str, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    from errormodel.yamlfile import flow

    instrument: Instrument = data.draw(settings_of(KINDS[word]))
    folder: Path = tmp_path_factory.mktemp("survey")
    (folder / "data.csv").write_text("X,Y,Z,mx,my,mz\n0,0,0,0,0,0\n10,10,10,10,10,10\n")
    block = flow(instrument.model_dump())
    (folder / "survey.yaml").write_text(f"errormodel: 1\nfiles: [{{path: data.csv}}]\ninstrument: {block}\n")
    again = read_survey(folder / "survey.yaml", read_machine("vertical_three_axis")).instrument
    assert again == instrument


# those of this package; another one's may require theirs
OWN = [word for word, kind in KINDS.items() if kind.__module__.startswith(f"{errormodel.__name__}.")]


@pytest.mark.parametrize("word", OWN)
def test_uncertainties_that_nobody_stated_are_estimated(word: str, tmp_path: Path) -> None:
    """Who knows only what he measured with says so, and gets the result of a survey without that line."""
    machine = read_machine("vertical_three_axis")
    simulate(machine, 60, {"X.dx.1": 0.02}, noise=0.003, seed=4).to_csv(tmp_path / "data.csv", index=False)
    (tmp_path / "survey.yaml").write_text(f"errormodel: 1\nfiles: [{{path: data.csv}}]\ninstrument: {{type: {word}}}\n")
    survey = read_survey(tmp_path / "survey.yaml", machine)
    assert not survey.instrument.stated
    notes = [n for n in survey.notes if "no uncertainties of it are stated" in n]
    assert len(notes) == (0 if word == Plain().type else 1)
    ours, bare = fit(machine, survey), fit(machine, read_survey(tmp_path / "data.csv", machine))
    pd.testing.assert_frame_equal(ours.parameters, bare.parameters)
