"""Lengths along lines and straightness, in runs of their own: one wrong observation is named, and soon.

How soon is counted in passes over the readings.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from errormodel.exceptions import InputError
from errormodel.survey import Survey
from identification.diagnosis.data_checks.gate import passed
from identification.estimation.fit import fit_machine
from identification.estimation.least_squares import Solver
from identification.estimation.result import Fit
from identification.importing.check import check_lines, check_survey
from tests.helpers.lines import ERRORS, GANTRY, along_lines


@pytest.fixture(scope="module")
def known() -> Survey:
    return along_lines("known")


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    count: Counter[str] = Counter()
    own = Solver.pass_

    def pass_(self: Solver, *args: Any, **keys: Any) -> Any:
        count["passes"] += 1
        return own(self, *args, **keys)

    monkeypatch.setattr(Solver, "pass_", pass_)
    return count


def changed(survey: Survey, label: str, factor: float) -> Survey:
    table = survey.table.copy()
    table.loc[table["observation"] == label, "length"] *= factor
    return replace(survey, table=table)


def fitted(survey: Survey) -> Fit:
    return passed(GANTRY, survey, lambda: fit_machine(GANTRY, survey))


def scale_of_x(fit: Fit) -> float:
    """Of the group that the laser along X sees, um over the travel."""
    return 1e3 * fit.solution.named()["X.dx.1"]


@pytest.mark.parametrize("beside", [0.0, 5.0, 60.0])
def test_stations_that_stand_on_their_lines_do_not_run_away_across_them(counted: Counter[str], beside: float) -> None:
    """Lengths along a line show where the station stands across it to second order at most."""
    fit = fitted(along_lines("per-run", beside))
    assert fit.solution.converged
    assert counted["passes"] < 150
    true = 1e3 * (ERRORS["X.dx.1"] - 750 * ERRORS["X.eb.1"])
    group = fit.solution.groups.ids.index("X.dx.1")
    at = fit.solution.groups.base.tolist().index(group)
    std = 1e3 * float(np.sqrt(fit.solution.covariance[at, at])) * fit.inflation
    assert scale_of_x(fit) == pytest.approx(true, abs=3 * std)
    assert std < 5.0
    assert fit.readings is not None
    sizes = {e.observation: e.nominal for e in fit.readings.errors(fit.survey)}
    assert max(sizes.values()) < 200.0  # um: stations as they fit the machine without errors best


def test_straightness_in_another_unit_is_named_by_the_fit(known: Survey, counted: Counter[str]) -> None:
    notes = fitted(changed(known, "SXz", 1000.0)).notes
    assert counted["passes"] < 120
    assert any("times as large as the declared uncertainty, those of SXz " in note for note in notes)
    (note,) = (n for n in notes if "fit the machine without errors better" in n)
    assert "contradicts them for those of SXz (" in note
    assert "in SXz first" in note


def test_lengths_of_the_wrong_sign_are_refused_by_a_check_as_by_the_fit(known: Survey, counted: Counter[str]) -> None:
    wrong = changed(known, "LX", -1.0)
    for look in (fitted, lambda data: check_survey(GANTRY, data)):
        with pytest.raises(InputError, match=r"half of the readings of 'LX' lie more than .* however it is set up"):
            look(wrong)
    assert counted["passes"] < 60


def test_observations_by_the_name_of_each_other_are_refused(known: Survey) -> None:
    table = known.table.copy()
    table["observation"] = table["observation"].replace({"D2": "D4", "D4": "D2"})
    wrong = replace(known, table=table)
    for look in (fitted, lambda data: check_survey(GANTRY, data)):
        with pytest.raises(InputError, match=r"the readings of 'D.' and 'D.' are exchanged") as error:
            look(wrong)
        assert "column observation" in str(error.value)


def test_a_right_survey_passes_a_check_with_its_uncertainties(known: Survey) -> None:
    said = [*check_lines(check_survey(GANTRY, known))]
    assert any(line.startswith("standard uncertainties of LX, LY, ") for line in said)
