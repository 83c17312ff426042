"""Every effect at every place that a survey shows, and how many of its rows their columns leave memory for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from errormodel.channels import POINT_CHANNELS
from errormodel.effects import registry
from errormodel.effects.base import Effect
from errormodel.exceptions import InputError
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.blocks import SINGLE

# bytes of all proposals' columns, by judgement: of an arm, with 22 000 proposals, some 720 rows are searched. Rows that
# are left out of a whole series (11 911) are predicted to 83 um by what they find
MEMORY = 400_000_000
USUAL = 2  # parameters of a proposal
LARGEST = 3_000_000_000  # bytes that a search may take, by judgement
ROW = USUAL * 3 * np.dtype(SINGLE).itemsize  # bytes of a proposal's columns in a row
OWN = 2000  # bytes of a proposal beside its columns, as measured


def proposed(linear: LinearModel) -> list[Effect]:
    """Every effect of the library at every place that a survey shows, by what it recorded.

    Raises
    ------
    InputError
        There are more than memory holds, which grow with the square of the number of joints.
    """
    scene = linear.scene
    every = (e for kind in registry().values() for e in kind.proposals(scene) if scene.shows(e.where))
    if not scene.moving:  # positions that were read where the machine was stopped are the error, and no cause of it
        every = (e for e in every if not {*POINT_CHANNELS} & {*e.drivers})
    most = LARGEST // (OWN + ROW * _fewest_rows(linear))
    out = list(islice(every, most + 1))
    if len(out) > most:
        found = f"{len(scene.moving)} joints move in it, and more than {most} effects at places would have to be tried"
        cure = "Use `errormodel fit`, or give a survey in which fewer of them move at a time"
        raise InputError(f"diagnose, machine {linear.chain.machine.name}", found, cure)
    return out


def enough_rows(linear: LinearModel, effects: Sequence[Effect]) -> int:
    """Rows of a survey of which all these proposals' columns fit into memory: an arm has many times as many.

    More where these leave no more observations than the geometry has parameters.
    """
    return max(MEMORY // (ROW * max(len(effects), 1)), _fewest_rows(linear))


def _fewest_rows(linear: LinearModel) -> int:
    """Rows with three observations for each parameter of the geometry."""
    return int(linear.basis.shape[1])
