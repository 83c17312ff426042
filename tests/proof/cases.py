"""Cases made from their specifications: the files a user would have, and the truth to be sealed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.proof import files, lookalike
from tests.proof.catalogue import BUILDERS
from tests.proof.hidden import Hidden, Situation, reach
from tests.proof.kinematics import Array, Chain, rotations
from tests.proof.machines import BUILDERS as MACHINES
from tests.proof.machines import NOISE, draw_geometry, with_model
from tests.proof.noise import draw_noise
from tests.proof.plans import PLANS, later, walk
from tests.proof.projection import Bench, heldout_errors
from tests.proof.seal import sealed, write_atomic
from tests.proof.specs import SEED, Spec
from tests.proof.world import draw_world

Rng = np.random.Generator
HELD_OUT = 150
AFTER = 1.5  # times the survey's duration, until which poses come after it
DRAWS = 50  # of a machine
DOWNWARDS = ("ram-sag", "beam-sag", "payload-sag", "joint-compliance")  # nothing gives way against a weight
NAMES_A_CAUSE = ("single", "weak", "mixture", "pair")  # and could name another one


@dataclass(frozen=True)
class Case:
    """A case ready to be written."""

    spec: Spec
    here: Bench
    there: Bench
    effects: list[tuple[Hidden, float]]
    measured: Array  # (n, 3)
    noise: Array  # (n, 3)
    wild: Array  # rows of outliers
    truth: dict[str, Any]


def make(spec: Spec) -> Case:
    """Draw a case; the same specification gives the same case."""
    rng = np.random.default_rng([SEED, spec.seed])
    machine = _machine(spec, rng)
    here, there = _benches(spec, machine, rng)
    own = np.random.default_rng([SEED, spec.seed, 7, *(ord(c) for c in "".join(spec.effects))])
    effects = []
    for name in spec.effects:
        hidden = BUILDERS[name](machine, own)
        assert hidden is not None
        effects.append((hidden, _amplitude(spec, here, hidden, own)))
    points = here.seen(here.points(effects))
    noise = here.noise.draw(points, here.sit.path.time, own)
    wild = np.sort(own.choice(len(points), 9, replace=False)) if spec.blunder == "outliers" else np.zeros(0, int)
    noise[wild] += own.choice([-1, 1], (len(wild), 3)) * own.uniform(25, 120, (len(wild), 3)) * here.noise.sigma
    case = Case(spec, here, there, effects, points + noise, noise, wild, {})
    return replace(case, truth=_truth(case))


def _machine(spec: Spec, rng: Rng) -> Chain:
    """A machine of the topology that can have the effects: a vertical axis that is the longest one tilts no floor."""
    for _ in range(DRAWS):
        machine = with_model(MACHINES[spec.topology](rng), spec.order, spec.first)
        if all(BUILDERS[name](machine, np.random.default_rng(0)) for name in spec.effects):
            return machine
    raise ValueError(f"{spec.name}: {spec.topology} cannot have {' and '.join(spec.effects)}")


def _benches(spec: Spec, machine: Chain, rng: Rng) -> tuple[Bench, Bench]:
    plan, sigma = PLANS[spec.plan], NOISE[spec.topology]
    rows = int(rng.integers(plan.rows[0], plan.rows[1] + 1))
    path = walk(machine, plan, rng, rows)
    duration = float(path.time[-1])
    begin, end = (duration, AFTER * duration) if spec.after else (0.0, duration)
    world = draw_world(rng, end)
    if spec.plan == "still":
        world = replace(world, sensors={n: 20.3 + rng.normal(0, 0.02, len(v)) for n, v in world.sensors.items()})
    sizes = [float(np.linalg.norm(e.offset)) for e in machine.elements] + [e.length for e in machine.prismatic]
    away = 1.5 * sum(sorted(sizes)[-3:])
    turn = rotations(np.array([[*rng.normal(0, 0.02, 2), rng.uniform(-3, 3)]]))[0]
    middle = rotations(np.array([[0.0, 0.0, rng.uniform(-3, 3)]]))[0] @ np.array([away, 0.0, -0.2 * away])
    values = draw_geometry(machine, sigma, rng)
    noise = draw_noise(spec.noise, sigma, away, rng)
    benches = []
    for one in (path, later(machine, plan, rng, HELD_OUT, begin, end)):
        sit = Situation(machine, one, world, -turn.T @ middle)
        benches.append(Bench(sit, values, turn, middle, noise))
    return benches[0], benches[1]


def _amplitude(spec: Spec, bench: Bench, hidden: Hidden, rng: Rng) -> float:
    """Amplitude of the projected signal to noise that the specification asks for, within what is physical."""
    unit = 0.01
    shift = bench.shift_of(hidden, unit)
    rms = float(np.sqrt(np.mean(np.sum(shift**2, axis=1))))
    sign = 1.0 if hidden.effect in DOWNWARDS else float(rng.choice([-1, 1]))
    if spec.kind == "unseen":
        return sign * unit * 6 * bench.noise.sigma / rms
    size = float(np.linalg.norm(bench.off(bench.whitened(shift))))
    low, high = spec.delta
    wanted = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return sign * min(unit * wanted / size, unit * hidden.physical * (0.02 + 8e-5 * reach(bench.sit.chain)) / rms)


def _truth(case: Case) -> dict[str, Any]:
    spec, here = case.spec, case.here
    clean = np.delete(np.arange(len(case.noise)), case.wild)
    if len(case.wild):
        base = oracle = None
    else:
        base, oracle = map(_printed, heldout_errors(here, case.there, case.effects, case.noise))
    return {
        "case": spec.name,
        "kind": spec.kind,
        "topology": spec.topology,
        "plan": spec.plan,
        "noise": spec.noise,
        "order": spec.order,
        "sigma_mm": _printed(np.std(case.noise[clean])),
        "n": len(case.noise),
        "effects": [_entry(case, h, a) for h, a in case.effects] + _blunder(case),
        "blunder": spec.blunder or None,
        "tolerate": ["outliers"] if spec.noise == "heavy" else [],
        "base_heldout_um": base,
        "oracle_heldout_um": oracle,
        "heldout": np.round(case.there.seen(case.there.points(case.effects)), 6).tolist(),
    }


def _entry(case: Case, hidden: Hidden, amplitude: float) -> dict[str, Any]:
    here = case.here
    shift = here.shift_of(hidden, amplitude)
    white = here.whitened(shift)
    left = here.off(white)
    delta = float(np.linalg.norm(left))
    absorbed = 1 - float(left @ left) / float(white @ white)
    others = [here.off(here.whitened(here.shift_of(h, a))) for h, a in case.effects if h is not hidden]
    alike = lookalike.Alike(here, hidden, left, np.array(others).reshape(len(others), len(left)).T)
    names = alike.names() if case.spec.kind in NAMES_A_CAUSE else {}
    accept = [*hidden.accept, *(n for n in hidden.also if n in names)]
    where = [*alike.places(), *(at for name in accept for at in names.get(name, ()))]
    return {
        "effect": hidden.effect,
        "accept": accept,
        "undecided": {name: at for name, at in names.items() if name not in accept},
        "where": list(dict.fromkeys(where)),
        "amplitude": _printed(amplitude),
        "value": None if hidden.factor is None else _printed(amplitude * hidden.factor),
        "delta": _printed(delta),
        "delta_joint": _printed(alike.delta),
        "absorbed": _printed(absorbed),
        "rms_um": _printed(1e3 * np.sqrt(np.mean(np.sum(shift**2, axis=1)))),
        "period": hidden.period,
    }


def _printed(value: float | np.floating[Any]) -> float:
    """To seven digits: processors add up sums differently beyond them, and a truth is to be the same bytes."""
    return float(f"{value:.7g}")


def _blunder(case: Case) -> list[dict[str, Any]]:
    spec, joints = case.spec, case.here.sit.chain.joints
    if spec.blunder == "outliers":
        return [{"effect": "outliers", "accept": ["outliers"], "where": ["instrument", "frame", "tool"], "delta": 99.0}]
    if spec.blunder in ("sign", "swap", "unit"):
        where = [j.name for j in joints] if spec.blunder == "swap" else [_spoilt(spec, joints)]
        return [{"effect": "axis-blunder", "accept": ["axis-blunder"], "where": where, "delta": 999.0}]
    return []


def _spoilt(spec: Spec, joints: tuple[Any, ...]) -> str:
    """The joint whose column has the wrong sign or unit."""
    if spec.blunder == "unit":
        return next((str(j.name) for j in joints if j.kind == "prismatic"), str(joints[0].name))
    return str(joints[spec.seed % len(joints)].name)


def _spoil(spec: Spec, chain: Chain, table: files.Columns) -> files.Columns:
    """The table with its blunder."""
    table = dict(table)
    name = _spoilt(spec, chain.joints)
    if spec.blunder == "sign":
        table[name] = -np.asarray(table[name], dtype=float)
    elif spec.blunder == "unit":
        table[name] = np.round(np.asarray(table[name], dtype=float) / 25.4, 6)
    elif spec.blunder == "swap":
        one, two = ((*chain.prismatic, *chain.joints))[:2]
        table[one.name], table[two.name] = table[two.name], table[one.name]
    return table


def write(case: Case, folder: Path, vault: Path) -> str:
    """Write a case's files into its folder and its truth into the vault; returns the seal."""
    spec, here, there = case.spec, case.here, case.there
    bare, chain = PLANS[spec.plan].bare, here.sit.chain
    dead = {"T_base": -999.0, "T_coolant": 20.37} if spec.blunder == "dead" else {}
    tables = []
    for bench in (here, there):
        witness: dict[str, Array] = {}
        for hidden, amplitude in case.effects:
            if hidden.witness is not None:
                witness |= hidden.witness(bench.sit, amplitude)
        tables.append(files.columns(bench.sit, bare, witness, dead))
    survey, heldout = (_spoil(spec, chain, t) for t in tables)  # one program writes both
    at = list(survey).index("tool_z") + 1
    measured = {f"m{a}": np.round(case.measured[:, k], 5) for k, a in enumerate("xyz")}
    survey = dict([*list(survey.items())[:at], *measured.items(), *list(survey.items())[at:]])
    write_atomic(folder / "machine.yaml", files.machine_yaml(chain, f"case {spec.name}"))
    files.write_csv(folder / "survey.csv", survey)
    files.write_csv(folder / "heldout.csv", heldout)
    if here.noise.declared and here.noise.kind == "tracker":
        write_atomic(folder / "survey.yaml", files.survey_yaml(here.noise))
    return sealed(vault / f"{spec.name}.json", case.truth)
