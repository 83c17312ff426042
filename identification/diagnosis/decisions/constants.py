"""The constants that decide in a diagnosis, each with its derivation or its calibration.

Limits of the work of a search (how many candidates are examined) are beside the code that they limit.
"""

from __future__ import annotations

from typing import NamedTuple


class CorrelatedNoise(NamedTuple):
    """Limits of what counts as noise: rows, the part of the longest series, and times the white variance."""

    rows: tuple[float, float]
    part: float
    variance: float


# ---- how much evidence
DECISIVE_ODDS = 100.0
"""Odds, beyond the trials factor, from which there is a finding: of 300 empty surveys of the proof the best had 30."""

LEAST_EVIDENCE = 7.0
"""Log Bayes factor, odds of 1000 to 1: with less nothing is examined, no search begins from it, and no rows contaminate
the noise. Of eight simulators by others the least of rows that did had 9.0, heavy tails that look so 6.1 at most."""

CLEARLY = 6.0
"""Log prior odds of physics that has a name against an empirical term, which fits anything, and against any other form
of the same motion by the same channel; calibrated by the Brier score of 389 findings of the proof (seeds 69069 and
271828). Near-ties are nearer than that."""

LEAST_P_VALUE = 1e-3
"""Chance below which a test of what is left finds something: one false alarm in 1000 surveys."""

# ---- how large a part
NEAR = 0.1
"""Of an alternative's evidence: refinements may make up for as much. Of what was fitted of a finding: it has hardly
changed. And a finding may lack as much evidence to what wanders: no form is exact."""

MUCH = 0.3
"""Of what a finding explains: as much is no departure from its form (`DEPARTURES`: e to the -8 beforehand). A witness
that certainly shows less of a motion contradicts it."""

LITTLE = 0.06
"""Of what a finding explains: as little may be left over from it, and is no other effect."""

NO_WORSE = 1.02
"""Times the cross-validation error: smaller differences are chance; by judgement."""

LEAST_SHARE = 0.01
"""Of the held-out variance: what predicts less changes no prediction."""

MISFIT_RATIO = 1.3
"""Ratio of variances from which residuals that significantly exceed repeats, or a declared uncertainty, matter: 14 % of
an uncertainty, which is seldom known better; by judgement."""

ABSORBED = 0.999
"""Of a column's length squared: an effect of which the geometry takes up more is collinear with it. What it leaves,
0.03 of the length, is no more than the least departure of a form (`DEPARTURES`)."""

FORM_ABSORBED = 0.99
"""The same of an empirical term, which has no size of its own to hold what the geometry leaves: 0.1 of the length."""

# ---- prior distributions
SIZES = {0.1: 0.1, 0.3: 0.2, 1.0: 0.4, 3.0: 0.2, 10.0: 0.1}
"""Times the usual size of an effect: how often, as machines are small and large."""

DEPARTURES = {0.03: 1.0, 0.1: 3.0, 0.3: 8.0}
"""Share of an effect's size by which it departs from its textbook form: minus the log prior probability."""

NOISE = CorrelatedNoise(rows=(20.0, 60.0), part=1 / 15, variance=2.0)
"""Of correlated noise: over so many rows and this part of the longest series at most (never less than the first),
with a variance of so many times that of white noise. Beyond them it is a drift with a cause."""

STEADY_UM = 4.0
"""Standard deviation, um, of what good instruments drift in a shop; by judgement."""

# ---- probability of a name (calibrated on 356 findings of five simulators by other authors and 201 of the proof)
CHOSEN = 0.5
"""Log odds of the name that was chosen, beside its evidence; with a larger lead another name's whole model is taken."""

UNKNOWN = 0.05
"""Odds that it is something else which no catalogue has, and which looks like the name."""

EVEN = 0.5
"""A name that is less likely than that is none. Also of white against correlated noise beforehand."""

NAME_ODDS = 1.0
"""Log prior odds of a name against a function without one, so that a tie is a name: of 112 right names (proof, seed
24112602, and another author's simulator) the least had 0 without them, forms that are such a function themselves."""

# ---- witnesses
SEEN = 6.0
"""Standard errors from which a witness shows a predicted motion; by judgement."""

AGREES = 10.0
"""Bayes factor of each witness that shows it; by judgement."""
