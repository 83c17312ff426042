"""What a search keeps of linear models is what would be made anew, however little is kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.arrays import Array, Index
from errormodel.effects.base import Effect
from errormodel.effects.unnamed import Unnamed
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.diagnosis.linear.known_models import Known, Latest, Lineage
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.blocks import Vectors
from identification.diagnosis.search.candidates import Candidates, score_of
from identification.diagnosis.search.filtered_models import FromBasis, FromProducts
from identification.estimation.fit import fit_machine
from identification.estimation.noise import Noise

GANTRY = Path(__file__).parents[2] / "machines/examples/gantry"


@pytest.fixture(scope="module")
def linear() -> LinearModel:
    machine = read_machine(GANTRY)
    return set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))


@pytest.fixture(scope="module")
def candidates(linear: LinearModel) -> Candidates:
    return Candidates.of(linear)


@pytest.fixture(scope="module")
def some(candidates: Candidates) -> list[Effect]:
    """Effects of which two are curves, one of these last but one: what follows has rows for it."""
    curves = [e for e in candidates.effects if e.random]
    plain = [e for e in candidates.effects if not e.random]
    rng = np.random.default_rng(1)
    a, b = (curves[k] for k in rng.choice(len(curves), 2, replace=False))
    c, d = (plain[k] for k in rng.choice(len(plain), 2, replace=False))
    return [c, a, b, d]


def beside(linear: LinearModel, effects: Sequence[Effect]) -> LinearModel:
    for effect in effects:
        linear = linear.with_effect(effect)
    return linear


@pytest.mark.long
def test_a_model_that_is_kept_is_the_one_that_is_made(linear: LinearModel, some: list[Effect]) -> None:
    first, again, anew = beside(linear, some), beside(linear, some), beside(replace(linear, lineage=None), some)
    assert first.lineage == again.lineage == Lineage(tuple(some))
    for other in (again, anew):
        np.testing.assert_array_equal(first.basis, other.basis)
        np.testing.assert_array_equal(first.residual, other.residual)
    np.testing.assert_allclose(first.basis.T @ first.basis, np.eye(first.basis.shape[1]), atol=1e-9)


def test_scores_are_the_same_whatever_was_scored_before(
    linear: LinearModel, candidates: Candidates, some: list[Effect]
) -> None:
    """Taken off step by step, or all at once; columns are kept in single precision."""
    branch = candidates.branch()
    for count in range(1, len(some) + 1):
        branch.scores(beside(linear, some[:count]))
    last = beside(linear, some)
    by_steps, at_once = branch.scores(last), candidates.branch().scores(last)
    seen = np.isfinite(at_once.evidence)
    np.testing.assert_array_equal(seen, np.isfinite(by_steps.evidence))
    np.testing.assert_allclose(by_steps.evidence[seen], at_once.evidence[seen], rtol=1e-3, atol=0.02)
    assert branch.scores(last).evidence is by_steps.evidence


@pytest.mark.long
def test_models_of_one_search_have_the_scores_that_they_have_without_it(
    linear: LinearModel, candidates: Candidates, some: list[Effect]
) -> None:
    """Products with all directions that were asked for give the model with the effects in any order and number."""
    branch = candidates.branch()
    for own in (some, some[1:], [*some[:2], some[3]], some[::-1]):
        model = linear.with_effects(own)
        np.testing.assert_allclose(model.square, beside(replace(linear, lineage=None), own).square, rtol=1e-9)
        found = branch.scores(model)
        anew = Candidates.of(linear).scores(replace(model, lineage=None))
        seen = np.isfinite(anew.evidence)
        np.testing.assert_array_equal(seen, np.isfinite(found.evidence))
        np.testing.assert_allclose(found.evidence[seen], anew.evidence[seen], rtol=1e-3, atol=0.02)


def test_principal_components_of_random_effects_have_their_covariance(linear: LinearModel, some: list[Effect]) -> None:
    for effect in (e for e in some if e.random):
        (whole,), _ = linear.swept([effect])
        columns, sizes = linear.columns(effect)
        assert len(columns) == len(sizes) <= len(whole)
        covariance = whole.T @ whole
        np.testing.assert_allclose(columns.T @ columns, covariance, atol=1e-7 * np.abs(covariance).max())


def test_one_effect_has_the_score_that_it_has_in_a_list(linear: LinearModel, some: list[Effect]) -> None:
    """But for rounding: a list's columns are kept in single precision."""
    for k, effect in enumerate(some):
        model = beside(linear, some[:k])
        scores = Candidates.of(model, [effect]).scores(model)
        of_list = scores.evidence[0], scores.delta_chi2[0], scores.absorbed[0]
        np.testing.assert_allclose(score_of(model, effect) or (), of_list, rtol=1e-3, atol=1e-3)


def test_scores_of_lists_that_were_joined_are_those_of_each(
    linear: LinearModel, candidates: Candidates, some: list[Effect]
) -> None:
    other = Candidates.of(linear, some)
    joined = candidates.joined(other).joined(other)
    model = beside(linear, some[:1])
    scores, ends = joined.scores(model), np.cumsum([0, len(candidates.effects), len(other.effects), len(other.effects)])
    assert joined.effects == [*candidates.effects, *other.effects, *other.effects]
    for own, start, end in zip((candidates, other, other), ends[:-1], ends[1:], strict=True):
        np.testing.assert_array_equal(scores.evidence[start:end], own.scores(model).evidence)
    assert max(joined.of_key[some[0].key]) >= ends[1]


def test_evidence_in_any_noise_is_the_same_step_by_step(linear: LinearModel, some: list[Effect]) -> None:
    alone = [[some[-1]]]
    for count in range(len(some)):
        coloured.evidence(beside(linear, some[:count]), alone)
    model = beside(linear, some[:-1])
    by_steps = coloured.evidence(model, alone)
    np.testing.assert_allclose(by_steps, coloured.evidence(replace(model, lineage=None), alone), rtol=1e-8)


def test_a_model_without_one_of_its_effects_is_made_of_products_that_are_there(
    linear: LinearModel, some: list[Effect], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing but the residual is filtered anew, and the evidence is that of the model that is made anew."""
    coloured.evidence(beside(linear, some[:-1]), [[some[-1]]])
    filtered = list[int]()
    weighed = Noise.weighed

    def counted(noise: Noise, columns: Array, edges: Index) -> Array:
        filtered.append(len(columns))
        return weighed(noise, columns, edges)

    for one in some[:-1]:
        model = beside(linear, [e for e in some if e is not one])
        with monkeypatch.context() as patch:
            patch.setattr(Noise, "weighed", counted)
            found = coloured.evidence(model, [[one]])
        np.testing.assert_allclose(found, coloured.evidence(replace(model, lineage=None), [[one]]), rtol=1e-8)
    assert set(filtered) == {1}


def test_effects_that_hold_each_other_or_nearly_so_have_the_evidence_of_what_they_span(linear: LinearModel) -> None:
    """A line beside a line and a parabola adds nothing; where products cannot tell, the basis is taken."""
    driver, moved = (j.name for j in linear.scene.moving[:2])
    common = {"element": moved, "motion": "eb", "driver": driver, "center": 0.0, "half_range": 500.0}
    line, square, cubic = (Unnamed.model_validate({**common, "form": f}) for f in ("linear", "square", "cubic"))
    wave, alike = (Unnamed.model_validate({**common, "period": p}) for p in (200.0, 200.0 * (1 + 1e-6)))
    for effects, rank, kind in (([line, square], 2, FromProducts), ([wave, alike], 4, FromBasis)):
        model = beside(linear, effects)
        assert model.basis.shape[1] == linear.basis.shape[1] + rank
        found, anew = (coloured.evidence(m, [[cubic]]) for m in (model, replace(model, lineage=None)))
        np.testing.assert_allclose(found, anew, rtol=1e-7)
        assert isinstance(coloured.filtered_model(model), kind)


def test_columns_of_one_lever_are_sums_over_rows(linear: LinearModel, candidates: Candidates) -> None:
    vectors = np.random.default_rng(2).normal(size=(linear.size, 3))
    by_rows = [b for b in candidates.blocks if b.lever is not None]
    assert sum(len(b.numbers) for b in by_rows) > len(candidates.effects) / 2
    for block in by_rows[::7]:
        columns = block.observed(linear.size)
        scale = np.sqrt(block.square)[:, :, None] * np.linalg.norm(vectors, axis=0)
        np.testing.assert_allclose(
            block.times(Vectors(vectors).on(block.lever)) / scale,
            columns @ vectors[: columns.shape[2]] / scale,
            atol=1e-6,
        )
        whole, length = block.whole(), np.sqrt(block.square)
        exact = columns @ columns.transpose(0, 2, 1)
        np.testing.assert_allclose((whole - exact) / length[:, :, None] / length[:, None, :], 0.0, atol=1e-5)


def test_what_was_not_asked_for_longest_goes_first() -> None:
    kept = Latest(most=10)
    kept.keep("a", 1, 4)
    kept.keep("b", 2, 4)
    assert kept.find("a") == 1
    other = kept.copy()
    kept.keep("c", 3, 4)
    assert [kept.find(k) for k in "abc"] == [1, None, 3]
    assert [other.find(k) for k in "abc"] == [1, 2, None]  # another search's own
    kept.keep("d", 4, 40)  # one is kept whatever its size
    assert [kept.find(k) for k in "acd"] == [None, None, 4]


def test_an_independent_search_keeps_its_own(linear: LinearModel, some: list[Effect]) -> None:
    start = replace(linear, lineage=Lineage((), Known()))
    branch = start.branch()
    assert branch.lineage is not None
    assert start.lineage is not None
    branch.with_effect(some[0])
    assert branch.lineage.known.further.find((some[0],)) is not None
    assert start.lineage.known.further.find((some[0],)) is None
