"""How far rows that were left out lie from what the model with all findings predicts there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.linear.row_residuals import spread
from identification.diagnosis.results.left_out import outlier_finding
from identification.estimation.fit import fit_machine
from tests.helpers.commands import MILL
from tests.helpers.surveys import measured, positions, survey

BAD, FAR, NOISE = [7, 40, 63], [0.10, -0.15, 0.08], 0.002


def recorded(machine: Machine) -> Survey:
    """60 um of lost motion, and three rows that are farther off."""
    values = Chain(machine).vector({i: 0.06 for i in Chain(machine).ids if "lost-motion" in i})
    table = positions(measured(machine, values, 120, 3, noise=NOISE))
    table.loc[BAD, "my"] += FAR
    return survey(table)


def left_out(data: Survey) -> tuple[Survey, np.ndarray]:
    table, bad = data.table.copy(), np.zeros(len(data.table), dtype=bool)
    bad[BAD] = True
    table.loc[bad, ["mx", "my", "mz"]] = np.nan
    return replace(data, table=table), bad


def test_rows_lie_as_far_as_they_are_from_what_the_final_model_predicts() -> None:
    """The plain fit, without the lost motion, has them as far as its own misfit besides."""
    plain = read_machine(MILL)
    machine = replace(plain, effects=(EffectSpec("lost-motion", {"joint": "X"}),))
    data = recorded(machine)
    rest, bad = left_out(data)
    final = fit_machine(machine, rest)
    found = outlier_finding(bad, fit_machine(plain, data).survey, final)
    size = 1e3 * np.array(FAR)
    assert found.size_um == pytest.approx(float(np.sqrt(np.mean(size**2))), abs=4)
    assert f"up to {found.statement.split('up to ')[1].split(' ')[0]} um" in found.brief
    assert float(found.statement.split("up to ")[1].split(" ")[0]) == pytest.approx(150, abs=6)
    assert "far outside anything" not in found.statement
    assert found.rows == [r + 1 for r in BAD]
    # with the findings, the rows that were left out of the fit in blocks, and beside them these
    assert found.heldout_rms_um.after == pytest.approx(spread(final, heldout=True).rms_um)
    n, k = 120 - len(BAD), len(BAD)
    both = (n * found.heldout_rms_um.after**2 + k * found.size_um**2) / (n + k)
    assert found.heldout_rms_um.before == pytest.approx(np.sqrt(both))
