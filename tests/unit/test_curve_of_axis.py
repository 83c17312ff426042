"""Error motions by their own axis's position alone are geometry of higher order where no special form is likely."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from identification.diagnosis.decisions.constants import EVEN
from identification.diagnosis.results.curve_of_axis import of_its_axis
from identification.diagnosis.results.findings import probability_of
from identification.diagnosis.search.scoring import Step
from tests.helpers.findings import made

KNEE = made("contact-knee", joint="X", motion="dy", at=100.0)
DENT = made("local-defect", joint="X", motion="dy", at=100.0, width=30.0)
CURVE = made("higher-order-geometry", joint="X", motion="dy")
BENT = made("cross-axis-compliance", joint="X", motion="ec", other="Y")


def step(effect: Any, evidence: float, *others: tuple[Any, float]) -> Step:
    own = Step(effect, evidence, 60.0, 0.1)
    return replace(own, alternatives=tuple(Step(e, v, 60.0, 0.1) for e, v in others))


def model(*steps: Step) -> Any:
    return SimpleNamespace(findings=[[s] for s in steps])


def test_forms_of_one_axis_are_together_what_none_is_alone() -> None:
    main = step(KNEE, 30.0, (DENT, 30.0), (CURVE, 30.0))
    assert probability_of(main) < EVEN
    assert of_its_axis(model(main), [main], None)[1] > 0.9


def test_what_another_axis_may_do_as_well_is_no_curve_of_one() -> None:
    main = step(KNEE, 30.0, (BENT, 30.0), (made("ground-compliance", joint="X"), 30.0))
    assert of_its_axis(model(main), [main], None)[1] < EVEN


@pytest.mark.parametrize(
    "other", [CURVE, made("unnamed", element="X", motion="dz", driver="time", center=0.0, half_range=1.0)]
)
def test_beside_a_curve_or_what_has_no_name_it_may_be_a_part(other: Any) -> None:
    main = step(KNEE, 30.0, (DENT, 30.0), (CURVE, 30.0))
    assert of_its_axis(model(main, step(other, 40.0)), [main], None) == (None, 0.0)


@pytest.mark.parametrize(("channels", "expected"), [(("X",), True), (("time",), False), (("X", "Y"), False)])
def test_a_function_without_a_name_by_the_axis_is_its_curve(channels: tuple[str, ...], expected: bool) -> None:
    main = step(KNEE, 30.0, (CURVE, 20.0))
    instead: Any = SimpleNamespace(channels=channels)
    assert (of_its_axis(model(main), [main], instead)[1] > EVEN) == expected
