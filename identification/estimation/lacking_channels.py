"""Test files that lack a channel which effects of the model depend on: they are judged without these effects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import lacking
from errormodel.effects import make
from errormodel.survey import Survey
from identification.estimation.result import Fit


def judged_without(fit: Fit, test: Survey) -> tuple[Survey, Array]:
    """A test file with zeros for channels that none of its rows has, and the fit's parameters without their effects.

    Returns
    -------
    The file, and the chain's parameters (mm, rad): those of effects that depend on such a channel are 0.
    """
    missing, held = _missing(fit.chain, test), fit.held
    if not missing:
        return test, held
    held = held.copy()
    for number in _effects_by(fit.chain, missing):
        held[[fit.chain.index[i] for i in fit.chain.effect_ids[number]]] = 0.0
    return replace(test, table=test.table.assign(**dict.fromkeys(missing, 0.0))), held


def lacking_notes(chain: Chain, test: Survey) -> Iterator[str]:
    """A note on the effects without which a test file is judged."""
    if missing := _missing(chain, test):
        name = test.table["file"].iloc[0]
        specs = [chain.machine.effects[k].effect for k in _effects_by(chain, missing)]
        yield (
            f"{name} has no {' and no '.join(missing)}: it is judged without {' and '.join(dict.fromkeys(specs))}, "
            "which the model has by that. Record it there, too"
        )


def _missing(chain: Chain, test: Survey) -> list[str]:
    """Columns that the model needs and no row of a test file has."""
    table = test.table
    there = [str(name) for name in table if table[name].notna().any()]
    absent = lacking(there, chain.channels)
    joints = {j.name for j in chain.machine.joints}
    return [name for name in absent if name not in joints]


def _effects_by(chain: Chain, missing: list[str]) -> list[int]:
    """Numbers of the effects that depend on some columns."""
    there = {*missing}
    return [
        k for k, spec in enumerate(chain.machine.effects) if there & {*lacking((), make(spec).channels(chain.machine))}
    ]
