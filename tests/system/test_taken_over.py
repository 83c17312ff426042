"""A search that begins anew with other directions of approach has the scores of one that takes nothing over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.approach import direction
from errormodel.channels import follows_sides
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search.criteria import heldout_rms
from identification.diagnosis.search.proposals import proposed
from identification.diagnosis.search.taken_over import Searched
from identification.estimation.fit import fit_machine
from tests.helpers.findings import known, made, survey_of

MILL = read_machine("vertical_three_axis")


def set_up_of(survey: Survey) -> LinearModel:
    return set_up(fit_machine(MILL, survey))


@pytest.fixture(scope="module")
def survey() -> Survey:
    true = known(MILL, made("backlash", joint="X"))
    return survey_of(true, random_points(MILL, 150, 5), {"X.dx.backlash": 0.03})


def turned(survey: Survey, every: int = 7) -> Survey:
    """With every seventh direction of X the other one."""
    side = direction(survey.table, "X").copy()
    side[::every] *= -1
    return replace(survey, table=survey.table.assign(dir_X=side))


@pytest.mark.long
def test_what_is_taken_over_has_the_scores_that_it_has_anew(survey: Survey) -> None:
    before = set_up_of(survey)
    first = Searched.of(before, proposed(before))
    first.candidates.scores(before)
    one = first.candidates.effects[0]
    heldout_rms(before.with_effect(one))
    linear = set_up_of(turned(survey))
    again = first.again(linear, proposed(linear))
    anew = Searched.of(linear, proposed(linear))
    scores, expected = again.candidates.scores(again.linear), anew.candidates.scores(linear)
    place = {effect: n for n, effect in enumerate(again.candidates.effects)}
    assert place.keys() == {*anew.candidates.effects}
    order = [place[effect] for effect in anew.candidates.effects]
    np.testing.assert_allclose(scores.evidence[order], expected.evidence, rtol=1e-4, atol=1e-3)
    follows = [any(map(follows_sides, e.channels(MILL))) for e in anew.candidates.effects]
    old = dict(zip(first.candidates.effects, first.candidates.scores(before).evidence, strict=True))
    some = [old[e] for e, sided in zip(anew.candidates.effects, follows, strict=True) if not sided]
    np.testing.assert_array_equal(scores.evidence[order][~np.array(follows)], some)
    assert any(follows)
    assert before.lineage is not None
    assert again.linear.lineage is not None
    kept = again.linear.lineage.known.answers
    assert len(before.lineage.known.answers) == 1
    assert len(kept) == (not any(map(follows_sides, one.channels(MILL))))


def test_directions_that_change_twice_leave_all_candidates_and_no_old_scores(survey: Survey) -> None:
    """Of three searches the third began with what follows directions only, and knew scores beside old ones."""
    linear = set_up_of(survey)
    searched = Searched.of(linear, proposed(linear))
    sided = next(e for e in searched.candidates.effects if any(map(follows_sides, e.channels(MILL))))
    for every in (7, 5):
        searched.candidates.scores(searched.linear.with_effect(sided))
        linear = set_up_of(turned(survey, every))
        searched = searched.again(linear, proposed(linear))
    anew = Searched.of(linear, proposed(linear))
    place = {effect: n for n, effect in enumerate(searched.candidates.effects)}
    assert place.keys() == {*anew.candidates.effects}
    order = [place[effect] for effect in anew.candidates.effects]
    for one, other in ((searched.linear, linear), (searched.linear.with_effect(sided), linear.with_effect(sided))):
        evidence = searched.candidates.scores(one).evidence[order]
        np.testing.assert_allclose(evidence, anew.candidates.scores(other).evidence, rtol=1e-4, atol=1e-3)


def test_nothing_is_taken_over_from_other_rows(survey: Survey) -> None:
    before = set_up_of(survey)
    first = Searched.of(before, proposed(before))
    heldout_rms(before)
    linear = set_up_of(replace(survey, table=survey.table.iloc[:-1]))
    again = first.again(linear, proposed(linear))
    assert again.linear is linear
    assert again.linear.lineage is not None
    assert not again.linear.lineage.known.answers


@pytest.mark.parametrize(
    ("name", "sided"), [("dir_X", True), ("play(X,0.01)", True), ("X", False), ("lag(T_a,9)", False)]
)
def test_which_channels_follow_the_direction_of_approach(name: str, sided: bool) -> None:
    assert follows_sides(name) == sided
