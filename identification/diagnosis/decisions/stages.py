"""The stages of a diagnosis, in their order."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from errormodel.effects.axis_blunder import AxisBlunder

DATA = "data checks"
OUTLIERS = "outliers"
NOISE = "instrument noise"
PROPOSALS = "candidates"
SELECTION = "forward selection"
COMPARISON = "model comparison"
CONDITIONAL = "evidence beside the other findings"
WITNESSES = "witness channels"
NAMES = "probability of a name"
UNTESTABLE = "untestable effects"
VERDICT = "verdict"

STAGES: Mapping[str, str] = MappingProxyType(
    {
        DATA: "mistakes in the recording are looked for, which no physics may explain",
        OUTLIERS: "rows far outside the noise are left out",
        NOISE: "the noise of an instrument that the survey does not name is looked for in the residuals",
        PROPOSALS: "every effect of the library is a candidate at every place and with every driver that was recorded",
        SELECTION: "candidates are scored, chosen, tested and added one by one, beside what was added before",
        COMPARISON: "the search is repeated from strong alternatives; the model with most evidence is kept",
        CONDITIONAL: "each finding and its alternatives are scored again beside all other findings",
        WITNESSES: "sensors on the members support a finding or contradict it",
        NAMES: "the evidence of a finding and its alternatives becomes probabilities of names",
        UNTESTABLE: "effects that this survey cannot show",
        VERDICT: "what is left is compared with what the noise may leave",
    }
)  # fmt: skip

CHECKED: Mapping[str, str] = MappingProxyType({"outliers": OUTLIERS, AxisBlunder.effect: DATA})
"""Findings that no candidate makes, and the stage that looks for them."""
