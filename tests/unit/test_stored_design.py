"""M and poses from motions of elements that are stored where they are not zero are those of the expressions."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.kernel import Kernel
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.estimation.fit import fit_machine
from identification.observation import models, stored_design
from identification.observation.assembly import build
from identification.observation.normal_equations import FULL_POSES, accumulate, design_rows
from identification.uncertainty.further_poses import leverages
from tests.helpers.commands import MILL
from tests.helpers.diagnosed import empty_survey

MACHINE = replace(
    read_machine(MILL),
    effects=(
        EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dz", "every": 10.0}),
        EffectSpec("backlash", {"joint": "Y"}),
        EffectSpec("higher-order-geometry", {"joint": "X", "motion": "dy", "degrees": [3], "slope": True}),
    ),
)


@pytest.fixture(scope="module")
def survey() -> Survey:
    return empty_survey(MACHINE, 700, 1, channels=False, grid=False)


@pytest.fixture
def of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """M is stored however few columns it has."""
    monkeypatch.setattr(models, "MANY", 1)
    monkeypatch.setattr(stored_design, "MOST_SHARE", 1.0)


@pytest.mark.usefixtures("of_any_size")
@pytest.mark.parametrize("part", [slice(None), slice(520, 650), slice(3, None, 7), np.array([5, 1, 699])])
def test_sums(survey: Survey, part: slice | np.ndarray) -> None:
    """Sums and rows of M of the view and of its parts, with weights; of some columns alone, too."""
    problem = build(Chain(MACHINE), survey)
    plain = replace(problem.views[0], whitener=np.linspace(1, 2, len(survey)))
    own = plain.storing_design()
    assert own.known_design is not None
    place, rng = problem.place(), np.random.default_rng(1)
    values, held, some = rng.normal(0, 1e-3, len(place)), np.zeros(len(problem.chain.ids)), np.array([2, 11])
    for exact, products_of in ((True, None), (False, None), (True, some)):
        found, expected = (
            accumulate([v.part(part)], place, values, held, exact=exact, lengths=True, products_of=products_of)[
                "position"
            ]
            for v in (own, plain)
        )
        for name in ("gram", "slope", "square", "count", "length", "longest"):
            one, other = (np.asarray(getattr(s, name)) for s in (found, expected))
            assert one == pytest.approx(other, rel=1e-10, abs=1e-10 * np.abs(other).max()), name
    rows = [design_rows(v.part(part), place, 100) for v in (own, plain)]
    assert rows[0] == pytest.approx(rows[1], rel=1e-12)


@pytest.mark.usefixtures("of_any_size")
def test_of_other_rows_it_is_not_known(survey: Survey) -> None:
    """A view that is given other rows does not have M of those before."""
    view = build(Chain(MACHINE), survey).views[0].storing_design()
    assert replace(view, rows=[c[::-1] for c in view.rows]).known_design is None
    assert replace(view, measured=view.measured + 1.0).known_design is not None  # type: ignore[call-arg, attr-defined]


@pytest.mark.usefixtures("of_any_size")
def test_poses(survey: Survey) -> None:
    """Position and orientation of the exact kinematics, where no other parameter is set."""
    view = build(Chain(MACHINE), survey).views[0]
    own, p = view.storing_design(), np.random.default_rng(2).normal(0, 1e-3, len(view.chain.ids))
    for outputs in ((0, 1, 2), tuple(range(3, 12))):
        found, expected = (np.hstack([part for _, part in v.pose_at(p, outputs)]) for v in (own, view))
        assert found == pytest.approx(expected, abs=1e-10)
    fewer = replace(view, ids=view.ids[:-1], columns=view.columns[:-1]).storing_design()
    assert fewer.known_design is not None
    assert fewer.known_design.pose(p, (0, 1, 2)) is None


@pytest.mark.usefixtures("of_any_size")
def test_views_of_the_same_rows_share_it(survey: Survey) -> None:
    """Positions and orientations of the same rows have the same motions; others have their own."""
    problem = build(Chain(MACHINE), survey)
    (view,) = problem.views
    alike, other = replace(view, rows=[c.copy() for c in view.rows]), view.part(slice(300))
    one, two, three = (v.known_design for v in replace(problem, views=(view, alike, other)).storing_design().views)
    assert one is not None
    assert two is not None
    assert three is not None
    assert two.matrix is one.matrix
    assert len(three) == 300


def test_where_few_entries_are_zero(survey: Survey, monkeypatch: pytest.MonkeyPatch) -> None:
    """M of few columns, or of which most entries are not zero, is not stored."""
    view = build(Chain(MACHINE), survey).views[0]
    assert len(view.columns) < stored_design.MANY
    assert view.storing_design() is view
    monkeypatch.setattr(models, "MANY", 1)
    monkeypatch.setattr(stored_design, "MOST_SHARE", 0.01)
    assert view.storing_design().known_design is None


def test_a_fit(survey: Survey, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same parameters, residuals of rows left out and leverages; all rows of M are evaluated once."""
    counted: Counter[int] = Counter()
    evaluated = Kernel.blocks

    def blocks(self: Kernel, rows, *more, **options):  # type: ignore[no-untyped-def]
        counted[self.n_functions] += len(rows[0]) * (len(rows[0]) != FULL_POSES)  # not over the full travels
        return evaluated(self, rows, *more, **options)

    plain = fit_machine(MACHINE, survey)
    monkeypatch.setattr(models, "MANY", 1)
    monkeypatch.setattr(stored_design, "MOST_SHARE", 1.0)
    monkeypatch.setattr(Kernel, "blocks", blocks)
    own = fit_machine(MACHINE, survey)
    assert counted[max(counted)] == len(survey)
    std = np.sqrt(np.diag(plain.solution.covariance))
    base = plain.solution.groups.base
    assert own.solution.values[base] == pytest.approx(plain.solution.values[base], abs=1e-6 * std.min(), rel=1e-9)
    assert own.heldout_residuals == pytest.approx(plain.heldout_residuals, abs=1e-8)
    assert leverages(own) == pytest.approx(leverages(plain), rel=1e-8)
