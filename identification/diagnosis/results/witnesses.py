"""Witness channels: a sensor on a member that sees its motion supports a finding there, or contradicts it.

A column ``w_<name>`` is a witness of a place if words of its name, apart by ``_``, are a chain element's name and a
motion (``w_level_X_ea``), an encoder or scale (a joint's own positioning: ``w_encoder_X``), or a level (rotations but
the one about the vertical: ``w_level_X``); a unit may follow (``_um``), else it is in mm or rad. Any other channel has
nothing to contradict, and drives what it drives.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.channels import root
from errormodel.conventions import MOTIONS, ROTATIONS, Motion
from errormodel.effects.base import Effect, axis_motion
from errormodel.machine import Joint, Machine
from errormodel.units import factor, is_unit
from identification.diagnosis.decisions.constants import AGREES, LEAST_EVIDENCE, MUCH, SEEN
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.statements import subject
from identification.diagnosis.search.model import EffectModel, of_groups
from identification.diagnosis.search.scoring import Step

ENCODER = re.compile(r"enc(oder)?\d*|scale|ruler", re.IGNORECASE)
LEVEL = re.compile(r"(spirit)?level\d*|tilt|incl(inometer)?", re.IGNORECASE)

Agreement = Literal["supports", "contradicts"]


@dataclass(frozen=True)
class Witness:
    """A channel and the motions of a chain element that it sees; it does not see `blind` of them (unknown which)."""

    name: str
    element: str
    motions: tuple[Motion, ...]
    scale: float  # to mm or rad
    blind: int = 0
    encoder: bool = False


@dataclass(frozen=True)
class WitnessResult:
    """Regression of a witness on a predicted motion: the share that it shows, with its standard error."""

    name: str
    word: Agreement
    share: float
    error: float

    against: str = ""  # the finding that it contradicted, where this one replaced it

    def __str__(self) -> str:
        share = f"{self.share:.2f} +- {self.error:.2f} of it"
        if self.against:
            return f"{self.name} does not show what {self.against} would do ({share})"
        return f"{self.name} {'shows it too' if self.word == 'supports' else 'does not show it'} ({share})"


def witnesses(machine: Machine, channels: Sequence[str]) -> Iterator[Witness]:
    """The channels whose names say what they see."""
    joints = {j.name: j for j in machine.joints}
    elements = [*joints, *(s.name for s in machine.shapes)]
    for name in channels:
        words = name.removeprefix("w_").split("_")
        element = next((e for e in elements if e in words), None)
        if element is None:
            continue
        unit = next((w for w in words[1:] if w != element and (is_unit(w, "length") or is_unit(w, "angle"))), "")
        motion = next((m for m in MOTIONS if m in words), None)
        joint = joints.get(element)
        if motion is not None:
            yield Witness(name, element, (motion,), _scale(unit, motion))
        elif joint is not None and any(ENCODER.fullmatch(w) for w in words):
            own = axis_motion(joint)
            yield Witness(name, element, (own,), _scale(unit, own), encoder=True)
        elif any(LEVEL.fullmatch(w) for w in words):
            yield Witness(name, element, ROTATIONS, _scale(unit, "ea"), blind=1)


def _scale(unit: str, motion: Motion) -> float:
    quantity: Literal["length", "angle"] = "angle" if motion in ROTATIONS else "length"
    return factor(unit, quantity) if unit and is_unit(unit, quantity) else 1.0


def apply_witnesses(
    model: EffectModel, log: DecisionLog = UNRECORDED
) -> tuple[EffectModel, dict[Effect, list[WitnessResult]]]:
    """The model without contradicted findings, and the witness results of each finding.

    A contradicted finding, with its refinements, is replaced by its best alternative that no witness contradicts.
    """
    start = model.start
    seen = list(witnesses(start.chain.machine, start.scene.witnesses))
    said: dict[Effect, list[WitnessResult]] = {}
    if not seen:
        return model, said
    groups: list[list[Step]] = []
    for group in model.findings:
        linear = model.without(group)
        results = _results(linear, group, seen)
        against = [t for t in results if t.word == "contradicts"]
        for t in results:
            if t.word == "supports":
                log.add("witness-supports", "kept", group[0].effect, abs(t.share) / t.error, SEEN, beside=t.name)
            else:
                log.add("witness-contradicts", "removed", group[0].effect, t.share, MUCH, beside=t.name)
        new = group
        if against:
            new = _instead(linear, group[0], seen)
            if not new:
                continue
            least = max(LEAST_EVIDENCE, group[0].evidence / 2)
            instead = new[0].effect, new[0].evidence, least
            log.add("uncontradicted-alternative", "kept", *instead, beside=group[0].effect)
            named = subject(group[0].effect)
            results = [*_results(linear, new, seen), *(replace(t, against=named) for t in against)]
        said[new[0].effect] = results
        groups.append(new)
    heeded = any(t.against for results in said.values() for t in results) or len(groups) < len(model.findings)
    return (of_groups(start, groups) if heeded else model), said


def with_witnesses(probability: float, results: Sequence[WitnessResult]) -> float:
    """The probability of a name, updated by its supporting witnesses (Bayes factor `AGREES` each)."""
    odds = AGREES ** sum(t.word == "supports" for t in results) * probability / max(1 - probability, 1e-9)
    return min(odds / (1 + odds), 0.999)


def _results(linear: LinearModel, group: Sequence[Step], seen: Sequence[Witness]) -> list[WitnessResult]:
    return [t for w in seen if (t := witness_result(linear, [s.effect for s in group], w)) is not None]


def witness_result(linear: LinearModel, effects: Sequence[Effect], witness: Witness) -> WitnessResult | None:
    """The result of a witness for the effects of one finding, given the rest; None where it shows neither."""
    own = effects[0]
    if witness.name in {root(d) for e in effects for d in e.drivers}:
        return None
    if witness.encoder and not own.traits().encoder_sees and not own.empirical:
        return None
    claims = _claims(linear, effects, witness)
    if len(claims) <= witness.blind:
        return None
    _, first = np.unique(linear.index, return_index=True)
    values = witness.scale * linear.channel(witness.name)[first]
    found = [_share(linear, witness.element, claim[first], values, first) for claim in claims]
    share, error = max(found, key=lambda f: abs(f[0]) / f[1])
    if abs(share) > SEEN * error:
        return WitnessResult(witness.name, "supports", share, error)
    sure = sum(abs(s) + 3 * e < MUCH for s, e in found)
    if sure == len(found):
        return WitnessResult(witness.name, "contradicts", share, error)
    return None


def _claims(linear: LinearModel, effects: Sequence[Effect], witness: Witness) -> list[Array]:
    """The motions of the witness' element that effects make, each (N,) in mm or rad; those that change."""
    machine = linear.chain.machine
    _, values = linear.estimates(list(effects))
    terms = [t for e in effects for t in e.terms(linear.channel, machine)]
    claims = []
    for motion in witness.motions:
        total = np.zeros(len(linear.index))
        for term, value in zip(terms, values, strict=True):
            if term.element == witness.element and motion in term.motion:
                total += value * term.motion[motion]
        if np.ptp(total) > 0:
            claims.append(total)
    return claims


def _share(linear: LinearModel, element: str, claim: Array, values: Array, rows: Index) -> tuple[float, float]:
    """Regression of a witness on a claimed motion beside a line in the element's position, and its standard error.

    The standard error allows for first-order autocorrelation.
    """
    joint: Joint | None = next((j for j in linear.chain.machine.joints if j.name == element), None)
    beside = [np.ones(len(values)), *([linear.channel(element)[rows]] if joint is not None else [])]
    design = np.column_stack([claim, *beside])
    norms = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv((design / norms).T @ (design / norms))
    solution = inverse @ (design / norms).T @ values
    left = values - design / norms @ solution
    noise = float(left @ left) / max(len(values) - design.shape[1], 1)
    follows = float(np.clip(left[1:] @ left[:-1] / max(left @ left, 1e-300), 0.0, 0.95))
    error = np.sqrt(noise * inverse[0, 0] * (1 + follows) / (1 - follows)) / norms[0]
    return float(solution[0] / norms[0]), float(max(error, 1e-9))


def _instead(linear: LinearModel, step: Step, seen: Sequence[Witness]) -> list[Step]:
    """The best alternative of a contradicted step that no witness contradicts, named effects first; or nothing."""
    for empirical in (False, True):
        for alternative in step.alternatives:
            if alternative.effect.empirical is not empirical or alternative.evidence < max(
                LEAST_EVIDENCE, step.evidence / 2
            ):
                continue
            alone = replace(alternative, delta_chi2=linear.delta_chi2(linear.with_effect(alternative.effect)))
            if any(t.word == "contradicts" for t in _results(linear, [alone], seen)):
                continue
            return [replace(alone, alternatives=tuple(r for r in step.alternatives if r is not alternative))]
    return []
