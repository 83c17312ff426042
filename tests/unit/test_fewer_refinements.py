"""What is given up in the fit of all rows: refinements that predict worse, and what cancels the geometry."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from errormodel.effects import make
from errormodel.effects.base import Effect
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis import kept_findings
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.search.model import replayed
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from tests.helpers.diagnosed import empty_survey


def test_the_second_of_two_refinements_of_one_key_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two time constants of one drift: without the second one the rows left out are predicted twice as well."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 120, 5, channels=True, grid=False)
    fit = fit_machine(machine, survey)
    drift = {"element": machine.elements[0].name, "motion": "dx", "sensor": "T_0"}
    effects = [make(EffectSpec("structure-drift", {**drift, "tau": tau})) for tau in (0.0, 300.0, 1500.0)]
    model = replayed(set_up(fit), [Step(e, 50.0, 100.0, 0.1, parent=0 if k else None) for k, e in enumerate(effects)])
    assert len({s.effect.key for s in model.steps}) == 1

    def error(of: object) -> float:
        return 50.0 if of is fit else 5.0 + 20.0 * (len(of.chain.machine.effects) != 2)  # type: ignore[attr-defined]

    monkeypatch.setattr(kept_findings, "_error", error)
    monkeypatch.setattr(kept_findings, "OPPOSED", float("inf"))  # these parts, of noise, cancel
    log = DecisionLog()
    shorter, final, _ = kept_findings.that_predicts(fit, model, survey, [], log)
    assert [s.effect for s in shorter.steps] == effects[:2]
    assert len(final.chain.machine.effects) == 2
    assert [d.rule for d in log if d.outcome == "removed"] == ["prediction-made-worse"]


def test_a_finding_that_cancels_the_geometry_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """What moves the tip by 24 mm where the plain fit leaves 7 um, as a curve does of commands that hardly differ."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 120, 5, channels=True, grid=False)
    fit = fit_machine(machine, survey)
    drifts = [
        make(EffectSpec("structure-drift", {"element": machine.elements[0].name, "motion": m, "sensor": "T_0"}))
        for m in ("dx", "dy")
    ]
    model = replayed(set_up(fit), [Step(e, 50.0, 100.0, 0.1) for e in drifts])

    def whole_of(final: Fit, effects: list[Effect], numbers: list[int]) -> SimpleNamespace:
        return SimpleNamespace(size_um=24e3 if effects[0] is drifts[0] else 300.0)

    monkeypatch.setattr(kept_findings, "whole_of", whole_of)
    monkeypatch.setattr(kept_findings, "_error", lambda of: 50.0 if of is fit else 5.0)
    monkeypatch.setattr(kept_findings, "spread", lambda of: SimpleNamespace(rms_um=7.0))
    log = DecisionLog()
    rest, final, _ = kept_findings.that_predicts(fit, model, survey, [], log)
    assert [s.effect for s in rest.steps] == drifts[1:]
    assert len(final.chain.machine.effects) == 1
    assert [d.rule for d in log if d.outcome == "removed"] == ["cancels-geometry"]


@pytest.mark.parametrize(("mended", "kept"), [(1.05, 1), (1.5, 2)])
def test_parts_that_cancel_stay_only_where_they_mend_much(
    mended: float, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two temperatures of one drift, each of 50 um, that do 7 um together: much mended is a gradient, little chance."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 120, 5, channels=True, grid=False)
    fit = fit_machine(machine, survey)
    drift = {"element": machine.elements[0].name, "motion": "dx"}
    one, two = (make(EffectSpec("structure-drift", {**drift, "sensor": s})) for s in ("T_0", "T_1"))
    model = replayed(set_up(fit), [Step(one, 50.0, 100.0, 0.1), Step(two, 50.0, 100.0, 0.1, parent=0)])

    def whole_of(final: Fit, effects: list[Effect], numbers: list[int]) -> SimpleNamespace:
        return SimpleNamespace(size_um=50.0 if len(effects) == 1 else 7.0)

    def error(of: Fit) -> float:
        return {0: 50.0, 1: 5.0 * mended, 2: 5.0}[len(of.chain.machine.effects)]

    monkeypatch.setattr(kept_findings, "whole_of", whole_of)
    monkeypatch.setattr(kept_findings, "_error", error)
    log = DecisionLog()
    rest, final, _ = kept_findings.that_predicts(fit, model, survey, [], log)
    assert [s.effect for s in rest.steps] == [one, two][:kept]
    assert len(final.chain.machine.effects) == kept
    assert ["opposed-parts" in d.rule for d in log].count(True) == 2 - kept
