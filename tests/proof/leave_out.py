"""The diagnosis without one of its rules: what each rule is worth, on cases in which it decided something.

A rule is left out by a constant or a function with which it never decides. Rules without which the search has no end,
or no choice at all (`detection`, `cross-validation`, `most-evidence`), and checks of the data are not in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import Any
from unittest.mock import patch

FOREVER = float("inf")


def _same(value: Any, *_: Any, **__: Any) -> Any:
    return value


def _none(*_: Any, **__: Any) -> None:
    return None


def _nothing(*_: Any, **__: Any) -> list[Any]:
    return []


def _no(*_: Any, **__: Any) -> bool:
    return False


_SEARCH, _RESULTS = "identification.diagnosis.search.", "identification.diagnosis.results."
_FORWARD, _COMPARED = _SEARCH + "forward_selection", _SEARCH + "model_comparison"
# rule: (module, name there, what it is without the rule)
LEFT_OUT: dict[str, tuple[tuple[str, str, float | Callable[..., Any]], ...]] = {
    "refinement-first": ((_FORWARD, "could_refine", _nothing),),
    "left-over": ((_FORWARD, "left_over", _none),),
    "share-of-findings": ((_FORWARD, "LITTLE", 0.0),),
    "competing-refinement": ((_FORWARD, "MOST_COMPETING", 0),),
    "second-sensor": ((_FORWARD, "add_second_sensor", _same),),
    "step-function": ((_FORWARD, "switched", _same),),
    "reselection": ((_FORWARD, "reselect", _same),),
    "superfluous": ((_FORWARD, "backward_eliminate", _same),),
    "nameless-alternative": (("identification.diagnosis.pipeline", "checked_alternative", _same),),
    "strong-alternative": ((_COMPARED, "_alternatives", _nothing),),
    "unmoved": ((_FORWARD, "NEAR", -1.0),),
    "empirical-lead": ((_SEARCH + "scoring", "CLEARLY", 0.0),),
    "line-of-sight": (("identification.diagnosis.extension", "tracker_noise", _none),),
    "second-cause": ((_COMPARED, "_second_causes", _nothing), (_COMPARED, "_two_names", _nothing)),
    "model-cross-validation": ((_COMPARED, "NO_WORSE", FOREVER),),
    "prediction-made-worse": (("identification.diagnosis.kept_findings", "NO_WORSE", FOREVER),),
    "wanders-instead": (("identification.diagnosis.extension", "without_wanderers", lambda m, log: (m, None)),),
    "wave-of-two-joints": (("identification.diagnosis.extension", "largest_wave", _none),),
    "unlikely-name": ((_RESULTS + "nameless_alternative", "probability_of", lambda step: 1.0),),
    "remainder-of-name": ((_RESULTS + "nameless_alternative", "MUCH", FOREVER),),
    "uncontradicted-alternative": (("identification.diagnosis.extension", "apply_witnesses", lambda m, log: (m, {})),),
    "non-repeatable-motion": ((_RESULTS + "residual_dependence", "non_repeatable_motion", _none),),
    "one-direction-instead": ((_SEARCH + "instrument_noise", "gain_of_covariance", lambda residuals: -FOREVER),),
    "serial-correlation": ((_RESULTS + "verdict", "wandering_text", lambda final, log: ""),),
    "physical-bound": ((_RESULTS + "physical_limits", "CONTRADICTED_SIGMA", FOREVER),),
    "physical-size": (
        (_RESULTS + "physical_limits", "LARGEST", FOREVER),
        ("identification.diagnosis.kept_findings", "LARGEST", FOREVER),
    ),
    "name-again": (("identification.diagnosis.extension", "with_names_again", _same),),
    "departure-of-form": (("identification.diagnosis.extension", "with_departures_merged", _same),),
    "part-of-itself": ((_RESULTS + "nameless_alternative", "_part_of_itself", lambda *_: ""),),
    "part-of-more": ((_RESULTS + "nameless_alternative", "part_of_more", lambda *_: ""),),
    "whole-model": (("identification.diagnosis.extension", "with_likelier_names", _same),),
}


@contextmanager
def left_out(rule: str) -> Iterator[None]:
    """Leave a rule out in this process; nothing where no name is given."""
    with ExitStack() as stack:
        for module, name, instead in LEFT_OUT[rule] if rule else ():
            stack.enter_context(patch.object(import_module(module), name, instead))
        yield
