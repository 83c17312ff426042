"""What every controller says of itself: words for people, and what of its contract holds before any fit."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.controllers import instead, registry, target
from errormodel.controllers.base import Controller, Rewriter
from errormodel.exceptions import InputError
from tests.helpers.setups import filled, plain_setup

NAMES = list(registry())
TABLED = [n for n in NAMES if issubclass(registry()[n], Controller)]


@pytest.mark.parametrize("name", NAMES)
def test_says_what_it_is(name: str) -> None:
    kind = registry()[name]
    assert kind.name == name == name.strip().lower()
    assert kind.__doc__
    for text in (kind.title, kind.source, kind.needs, kind.back):
        assert text.strip()
    for text in (kind.needs, kind.back):  # words within a sentence
        assert not text.strip().endswith(".")
    steps = target(name).checklist(plain_setup())
    assert steps
    assert all(isinstance(step, str) and step.strip() for step in steps)
    assert target(name).quantum(plain_setup()) > 0


@pytest.mark.parametrize("name", TABLED)
def test_terms_and_corrections_are_finite(name: str) -> None:
    controller, setup = target(name), plain_setup()
    assert isinstance(controller, Controller)
    terms = controller.structures(setup)[-1][: controller.most_tables]
    assert terms
    for term in terms:
        assert all(np.all(np.diff(grid) > 0) for grid in term.grids)
        assert set(term.inputs) <= set(setup.names)
        slope = controller.most_slope(setup, term)
        assert slope is None or slope > 0
    q = np.random.default_rng(0).uniform([a.travel[0] for a in setup.axes], [a.travel[1] for a in setup.axes], (50, 3))
    tables = filled(controller, setup, terms, np.random.default_rng(1))
    moved = controller.emulate(tables, setup, q, np.ones_like(q))
    assert moved.shape == (50, len(setup.movers))
    assert np.isfinite(moved).all()


@pytest.mark.parametrize("name", TABLED)
def test_zero_tables_change_no_command(name: str) -> None:
    """A move nobody commanded: tables of zeros add nothing, anywhere, as written and read back."""
    controller, setup = target(name), plain_setup()
    assert isinstance(controller, Controller)
    terms = controller.structures(setup)[-1][: controller.most_tables]
    tables = filled(controller, setup, terms, np.random.default_rng(1), size=0.0)
    assert all(np.all(t.values == 0) for t in tables)
    back = controller.read(controller.write(tables, setup), setup)
    q = np.random.default_rng(0).uniform([a.travel[0] for a in setup.axes], [a.travel[1] for a in setup.axes], (50, 3))
    assert np.abs(controller.emulate(back, setup, q, np.ones_like(q))).max() <= controller.quantum(setup)


@pytest.mark.parametrize("name", TABLED)
def test_foreign_files_are_refused(name: str) -> None:
    controller = target(name)
    assert isinstance(controller, Controller)
    for files in ({}, {"picture.png": "not a table"}):
        with pytest.raises(InputError):
            controller.read(files, plain_setup())


@pytest.mark.parametrize("name", TABLED)
def test_one_that_corrects_no_readings_names_those_that_do(name: str) -> None:
    controller = target(name)
    assert isinstance(controller, Controller)
    if type(controller).probing is not Controller.probing:
        return
    with pytest.raises(InputError) as refused:
        controller.probing(plain_setup(), lambda q: np.zeros(len(q)))
    able = [n for n in TABLED if registry()[n].probing is not Controller.probing]  # type: ignore[attr-defined]
    assert able
    assert all(n in refused.value.cure for n in able)


def test_what_is_named_instead_holds_any_error() -> None:
    general = [n for n in NAMES if registry()[n].general]
    assert instead() == " or ".join(general)
    assert instead(Rewriter) in general
    assert instead(Controller) in general
