"""Grades of the weight of evidence, and prior odds of classes of effects: natural logarithms of odds.

Choice, acceptance, comparison of models, alternatives and the reported probability share them. The grades go on from
those of H. Jeffreys, Theory of Probability, 3rd edition 1961, appendix B.
"""

from __future__ import annotations

from math import log

STRONG = log(10)  # less is a near-tie
DECISIVE = log(100)  # a finding, beyond the trials factor: of 300 empty surveys the best had 3.4
BEYOND_DOUBT = log(1000)  # less is not looked at closely, and does not overturn what was found

FIXED_FORM = STRONG  # prior odds of physics of a fixed form against an effect that follows any smooth curve
PHYSICS = BEYOND_DOUBT  # prior odds of an effect that has a name against an empirical term
