"""Certified linear regressions (NIST StRD, public domain) through the solver that fits machines.

A polynomial is an error motion of one joint, read by an instrument with a zero of its own (the intercept); Longley's
six regressors are temperatures that move a carriage; a line through the origin is a scale, seen from a known frame.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from errormodel.machine import Basis, EffectSpec, Joint, Machine
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from tests.helpers.chains import Array
from tests.helpers.surveys import survey

SETS: dict[str, dict[str, Any]] = json.loads((Path(__file__).parent / "nist_strd.json").read_text())
# digits that are right of each set's worst coefficient, and of its worst standard deviation; Wampler1 and 2 are exact.
# They differ by half a digit between builds of NumPy: of Wampler4's deviations 9.96 digits were right with one of them.
DIGITS = {
    "Norris": (12, 12), "Pontius": (12, 12), "NoInt1": (13, 13), "NoInt2": (13, 13), "Longley": (10, 11),
    "Wampler1": (9, 0), "Wampler2": (12, 0), "Wampler3": (9, 10), "Wampler4": (7, 9), "Wampler5": (5, 10),
    "Filip": (7, 7),  # of degree ten: its scaled columns are alike to nine digits
}  # fmt: skip


def rows(x: Array, **more: object) -> pd.DataFrame:
    blank = dict.fromkeys(["mx", "my", "mz"], np.nan) | dict.fromkeys(["tool_x", "tool_y", "tool_z"], 0.0)
    table = pd.DataFrame({"X": x, **blank, **more})
    return table.assign(run="1", file="a.csv", role="fit", row=np.arange(1, len(x) + 1))


def regressed(name: str) -> tuple[Array, Array, Fit]:
    """Coefficients and their standard deviations as NIST writes them, and the fit."""
    data = SETS[name]
    x, y = np.array(data["x"]), np.array(data["y"])
    if x.ndim == 2:
        effects = tuple(
            EffectSpec("structure-drift", {"element": "X", "motion": "dx", "sensor": f"T_{k}"}) for k in range(6)
        )
        machine = Machine("Longley", (Joint("X", "prismatic", (1, 0, 0), (0, 1), {}),), (0, 0, 0), effects=effects)
        temperatures = {f"T_{k}": column for k, column in enumerate(x.T)}
        fit = fit_machine(machine, survey(rows(np.zeros(len(y)), joint="X", dx=y, **temperatures)))
        turn = np.eye(7)  # temperatures count from 20 degC
        turn[0, 1:] = -20
    else:
        size = float(np.abs(x).max())
        joint = Joint(
            "X", "prismatic", (1, 0, 0), (min(x.min(), 0), max(x.max(), 0)), {"dx": Basis("polynomial", data["degree"])}
        )
        machine = Machine(name, (joint,), (0, 0, 0))
        if data["intercept"]:
            fit = fit_machine(machine, survey(rows(x, joint="X", dx=y)))
        else:
            fit = fit_machine(machine, survey(rows(x).assign(mx=x + y, my=np.nan, mz=np.nan), frame="fixed"))
        turn = np.diag(size ** -np.arange(1.0 - data["intercept"], data["degree"] + 1))
    s = fit.solution
    names = [s.unknowns[j] for j in s.groups.base]
    order = np.argsort([not n.startswith("zero") for n in names], kind="stable")
    beta, covariance = s.values[s.groups.base][order], s.covariance[np.ix_(order, order)]
    return turn @ beta, np.sqrt(np.diag(turn @ covariance @ turn.T)), fit


def digits(found: Array, certified: Array) -> float:
    """Decimal digits of the worst value that are right (absolute ones where zero is certified)."""
    wrong = np.abs(found - certified) / np.where(certified == 0, 1, np.abs(certified))
    return float(-np.log10(max(wrong.max(), 1e-16)))


@pytest.mark.parametrize("name", DIGITS)
def test_certified_values(name: str) -> None:
    beta, deviation, fit = regressed(name)
    data = SETS[name]
    of_beta, of_deviation = DIGITS[name]
    assert digits(beta, np.array(data["beta"])) > of_beta
    noise = next(iter(fit.solution.sigma.values()))
    if data["residual_sd"]:
        assert digits(deviation, np.array(data["sd"])) > of_deviation
        assert digits(np.array([noise]), np.array([data["residual_sd"]])) > of_deviation
    else:
        assert noise < 1e-13 * max(data["y"])
