"""How far a lag is led astray by temperatures between commands: as far as it is, over many recordings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from errormodel.channels import lagged
from identification.uncertainty.unknown_temperatures import led_astray
from tests.helpers.nightly import first_of


@pytest.mark.parametrize("hours", first_of([1.0, 0.5, 3.0]))
@pytest.mark.parametrize("tau", [300.0, 1800.0])
def test_the_stated_deviation_is_that_of_the_lag(hours: float, tau: float) -> None:
    """Temperatures that wander about a level (Ornstein-Uhlenbeck): recorded for six hours, then every so many hours."""
    rng, step = np.random.default_rng(2), 60.0
    wrong, stated = [], []
    for _ in range(40):
        time = np.arange(0, 24 * 3600, step)
        keep = np.exp(-step / 1800)
        shocks = rng.normal(0, np.sqrt(1 - keep**2), len(time))
        bed = lfilter([1.0], [1.0, -keep], shocks)
        known = time < 6 * 3600
        later = np.arange((6 + hours) * 3600, 24 * 3600, hours * 3600)
        truth = np.interp(later, time, lagged(time, bed, tau))
        both = np.append(time[known], later)
        taken = lagged(both, np.interp(both, time, bed), tau)[known.sum() :]
        wrong.append(taken - truth)
        stated.append(led_astray(time[known], bed[known], later, tau))
    ratio = np.sqrt(np.mean(np.square(wrong)) / np.mean(np.square(stated)))
    assert 0.75 < ratio < 1.33
    assert np.mean(np.abs(wrong) > 2 * np.array(stated)) < 0.12


def test_what_begins_anew_is_as_far_from_equilibrium_as_the_recording_was() -> None:
    """Commands some day later, in which the lag is taken to begin with its sensor's temperature, and forgets that."""
    rng, step, tau = np.random.default_rng(2), 60.0, 1800.0
    wrong, stated = [], []
    for _ in range(40):
        time = np.arange(0, 48 * 3600, step)
        keep = np.exp(-step / 3600)
        bed = lfilter([1.0], [1.0, -keep], rng.normal(0, np.sqrt(1 - keep**2), len(time)))
        known, rows = time < 8 * 3600, (time >= 40 * 3600) & (time < 41 * 3600)
        wrong.append(lagged(time[rows], bed[rows], tau) - lagged(time, bed, tau)[rows])
        stated.append(led_astray(time[known], bed[known], time[rows] - time[rows][0], tau, goes_on=False))
    ratio = np.sqrt(np.mean(np.square(wrong), axis=0) / np.mean(np.square(stated), axis=0))
    assert ratio.min() > 0.65
    assert ratio.max() < 1.5
    assert np.mean(stated, axis=0)[-1] < 0.2 * np.mean(stated, axis=0)[0]


def test_nothing_is_uncertain_where_temperatures_change_evenly_or_were_recorded() -> None:
    time = np.linspace(0, 7200, 200)
    bed = 20 + time / 1800
    assert led_astray(time, bed, np.array([7300.0, 20000.0, 90000.0]), 1200.0) == pytest.approx(0.0, abs=1e-9)
    wave = 20 + np.sin(time / 300)
    within = led_astray(time, wave, time[40:60], 1200.0)
    after = led_astray(time, wave, np.array([7200.0 + 3600.0]), 1200.0)
    assert within.max() < 0.01 * after[0]
