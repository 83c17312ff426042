"""What the effects of one family have in common. A family that is not listed here has the defaults.

An effect of another kind says so itself: it overrides :meth:`errormodel.effects.base.Effect.traits`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Traits:
    """Properties of a family of effects.

    Attributes
    ----------
    form_uncertainty : standard uncertainty of an effect's form, relative to its size: no form of a textbook is exact.
        0 of what has no form (a play, a step).
    encoder_sees : whether an encoder or a scale at the joint shows it. Its own growth, and a lever, it does not show.
    of_machine : whether something of the machine moves, which a command can take away.
    physical : whether it is physics, and no mistake in a table: a survey can be asked whether it could show it.
    """

    form_uncertainty: float = 0.0
    encoder_sees: bool = False
    of_machine: bool = True
    physical: bool = True


# form_uncertainty: from recordings whose truth is known, what a fit by the best form leaves of an effect that is not
# of the library's form
FAMILIES: Mapping[str, Traits] = {
    "geometric": Traits(0.06),
    "gravity": Traits(0.06),
    "thermal": Traits(0.09),
    "periodic": Traits(0.05, encoder_sees=True),
    "reversal": Traits(encoder_sees=True),
    "dynamic": Traits(encoder_sees=True),
    "gantry": Traits(),
    "instrument": Traits(0.03, of_machine=False),
    "blunder": Traits(of_machine=False, physical=False),
    "empirical": Traits(0.10),
}
