"""Effects that are likely and not found: predictions elsewhere are as uncertain as they are wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.results import store
from identification.results.predictions import predicted
from tests.helpers.commands import MILL, XYZ, done
from tests.helpers.diagnosed import empty_survey, showing

GROWS = EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_X"})
AMOUNT, NOISE_MM, ROWS = 1.2e-6, 0.005, 200  # 1/K: some four standard uncertainties of it


def recorded(temperatures: Array, first_s: float, noise: float, seed: int) -> Survey:
    """Random points at some temperatures of X, which grows a little."""
    machine, rows = read_machine(MILL), len(temperatures)
    survey = empty_survey(machine, rows, seed, channels=False, grid=False)
    table = survey.table.assign(time=first_s + np.linspace(0, 3600, rows), T_X=temperatures)
    return showing(replace(survey, table=table), machine, [(GROWS, [AMOUNT])], noise, 4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The diagnosis of a recording that shows the growth with odds of 3 to 1."""
    here = tmp_path_factory.mktemp("grown")
    survey = recorded(np.round(20 + 10 * np.sin(np.linspace(0, 7, ROWS)), 2), 0.0, NOISE_MM, 4)
    columns = [*(j.name for j in read_machine(MILL).joints), "time", "T_X", *XYZ]
    survey.table[columns].to_csv(here / "s.csv", index=False)
    done("diagnose", MILL, here / "s.csv", "--out", here / "d")
    return here / "d"


def test_it_is_no_finding_and_is_said(folder: Path) -> None:
    diagnosis = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert (diagnosis["verdict"], diagnosis["findings"]) == ("adequate", [])
    (note,) = (n for n in diagnosis["notes"] if n.startswith(("perhaps there", "probably there")))
    assert "scale-expansion of X (probability 0." in note
    assert "To settle it: " in note
    text = done("explain", folder, "scale-expansion@X").out
    assert text.startswith("scale-expansion@X was not found, and may be there")
    assert "perhaps-there: 0." in text


def test_it_is_in_the_uncertainty_of_predictions(folder: Path) -> None:
    """15 K beyond the recording it is most of the error. What was not found moves no prediction."""
    fit = store.load(folder)
    assert {other.effect for other in fit.others} == {len(fit.chain.machine.effects)}
    later = recorded(np.full(150, 45.0), 7200.0, 0.0, 54)
    # what a recording leaves open of expansions is another part of the uncertainty, and covers it alone
    known = fit.data | {"expansions": {j.name: {"T_X": 0.0} for j in fit.chain.machine.joints}}
    without, with_it = (predicted(replace(fit, others=others, data=known), later) for others in ((), fit.others))
    pd.testing.assert_frame_equal(without[[*XYZ]], with_it[[*XYZ]])
    error = np.abs(np.array(with_it[[*XYZ]]) - np.array(later.table[[*XYZ]]))
    covered = [float(np.mean(error < 2 * np.array(p[["ux", "uy", "uz"]]))) for p in (without, with_it)]
    assert covered[0] < 0.6
    assert covered[1] > 0.9


def test_one_more_effect_has_to_have_a_name(folder: Path, tmp_path: Path) -> None:
    """Of a file that was edited: said, and no traceback."""
    fit = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    fit["other_effects"][0]["name"] = ""
    for path in folder.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "fit.json").write_text(json.dumps(fit), encoding="utf-8")
    with pytest.raises(InputError, match="key other_effects: the effect number 1, which the machine does not have"):
        store.load(tmp_path)
