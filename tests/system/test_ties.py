"""Effects that do the same to all rows: neither rounding nor what was read off the machine decides between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.channels import POINT_CHANNELS
from errormodel.machine_file import read_machine
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.proposals import proposed
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey


def test_effects_alike_come_in_the_same_order_however_scores_are_rounded() -> None:
    """Of three runs the second one, or the first and the third: the shift is the same, and rounding had chosen."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 240, 5, channels=True, grid=False)
    table = survey.table.assign(run=np.repeat(["1", "2", "3"], 80))
    knocked = (table["run"] == "2").to_numpy()
    table.loc[knocked, ["mx", "my", "mz"]] += [0.012, -0.004, 0.007]
    linear = set_up(fit_machine(machine, replace(survey, table=table)))
    candidates = Candidates.of(linear)
    scores = candidates.scores(linear)
    ranked = [n for _, n in scores.by_key()][:8]
    first = candidates.effects[ranked[0]]
    assert (first.effect, first.where, getattr(first, "run", None)) == ("target-offset", "tool", "2")
    rng = np.random.default_rng(1)
    for _ in range(20):  # as kernels of linear algebra differ, in single precision
        rounded = replace(scores, evidence=scores.evidence * (1 + rng.normal(0, 3e-6, len(scores.evidence))))
        assert [n for _, n in rounded.by_key()][:8] == ranked


def test_positions_read_where_the_machine_was_stopped_are_no_cause() -> None:
    """They are what was measured: as a driver they would explain all of it, by itself."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 120, 5, channels=True, grid=False)
    stopped = survey.table.assign(**{j.name: np.mean(j.travel) for j in machine.joints})
    stopped[machine.joints[0].name] += np.random.default_rng(1).normal(0, 0.05, len(stopped))
    for table, driven in ((survey.table, True), (stopped, False)):
        effects = proposed(set_up(fit_machine(machine, replace(survey, table=table))))
        assert effects
        assert any({*POINT_CHANNELS} & {*e.drivers} for e in effects) == driven
