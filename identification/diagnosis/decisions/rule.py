"""A rule of the diagnosis, and the scales of its values."""

from __future__ import annotations

from typing import NamedTuple

EVIDENCE = "log Bayes factor"
DELTA = "share of delta chi-squared"
ERRORS = "ratio of cross-validation errors"
GAIN = "log likelihood ratio"
RATIO = "ratio"
SHARE = "share"
COUNT = "number"
CHANCE = "p-value"


class Rule(NamedTuple):
    """One rule.

    Attributes
    ----------
    stage : a key of `STAGES`.
    scale : of value and threshold; empty where neither is a number.
    decides : what it decides, one sentence.
    constants : ``module.NAME`` of its thresholds; none where the data themselves are the threshold.
    """

    stage: str
    scale: str
    decides: str
    constants: tuple[str, ...] = ()


def decided(*names: str) -> tuple[str, ...]:
    """Constants of the one table (`decisions.constants`), as a rule names them."""
    return in_module("decisions.constants", *names)


def in_module(module: str, *names: str) -> tuple[str, ...]:
    """Constants of one module, as a rule names them."""
    return tuple(f"{module}.{name}" for name in names)
