"""The project's own proof: its simulator against closed forms, its seals, and a small selection of its cases.

The whole is ``python -m tests.proof``; here a few cases with fixed seeds stand for it.
"""

from __future__ import annotations

import ast
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at
from errormodel.truth import Truth
from identification.diagnosis.decisions.rules import RULES
from tests.helpers.nightly import first_of
from tests.proof import files, kinematics, machines, physics_beams, physics_drives, world
from tests.proof.cases import make, write
from tests.proof.catalogue import BUILDERS
from tests.proof.kinematics import geometry, position
from tests.proof.leave_out import LEFT_OUT, left_out
from tests.proof.noise import Noise
from tests.proof.plans import PLANS, walk
from tests.proof.rivals import FORMS
from tests.proof.run_case import run_case
from tests.proof.score import Scored, at, calibration, says, wilson
from tests.proof.seal import BrokenSealError, opened, sealed
from tests.proof.specs import Spec, all_specs

PROOF = Path(__file__).parent
OUTSIDE = ("run_case", "score", "__main__", "test_proof")  # all else is the simulator
SPECS = {s.name: s for s in all_specs()}
# the cheapest of each kind among the first hundred, whatever came of them; white, coloured, clustered, poor, ...; but
# for those that the third notebook and the README run
EMPTY = tuple(f"empty-{k:03}" for k in (4, 8, 9, 12))
NAMED = (*(f"single-{k:03}" for k in (7, 9, 11, 16)), "pair-003", "mixture-006")
OTHER = ("unnamed-003", "unseen-001", "unseen-002", "weak-001", "blunder-000")  # notebook 03 has seven more


def modules_behind(start: Path) -> dict[str, set[str]]:
    """All modules that a module of the proof imports, through others of the proof; by the proof's module."""
    found: dict[str, set[str]] = {}
    waiting = [start]
    while waiting:
        file = waiting.pop()
        if file.stem in found:
            continue
        own = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                own |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.module
                own |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        found[file.stem] = own
        waiting += [PROOF / f"{m.split('.')[2]}.py" for m in own if m.startswith("tests.proof.") and m.count(".") == 2]
        waiting = [w for w in waiting if w.exists()]
    return found


def test_the_simulator_imports_nothing_of_the_toolkit() -> None:
    files_of = [f for f in PROOF.glob("*.py") if f.stem not in OUTSIDE]
    assert len(files_of) > 15
    for file in files_of:
        for module, names in modules_behind(file).items():
            assert module not in OUTSIDE
            assert not {n for n in names if n.split(".")[0] in ("errormodel", "identification")}, module


@pytest.mark.parametrize("topology", list(machines.BUILDERS))
@pytest.mark.parametrize(("order", "first"), [(2, False), (1, True)])
def test_kinematics_agree_with_the_toolkit(tmp_path: Path, topology: str, order: int, first: bool) -> None:
    rng = np.random.default_rng(3)
    chain = machines.with_model(machines.BUILDERS[topology](rng), order, first)
    path = walk(chain, PLANS["random"], rng, 40)
    values = machines.draw_geometry(chain, 0.01, rng)
    own = position(chain, path.q, path.tool, geometry(chain, path.q, values, len(path)))
    (tmp_path / "machine.yaml").write_text(files.machine_yaml(chain, topology))
    machine = read_machine(tmp_path / "machine.yaml")
    table = pd.DataFrame({**path.q, **{f"tool_{a}": path.tool[:, k] for k, a in enumerate("xyz")}})
    theirs = measured_at(machine, table, Truth(values))[["mx", "my", "mz"]].to_numpy()
    assert set(values) == set(Chain(machine).machine_ids)
    assert np.abs(own - theirs).max() < 1e-9


def test_cantilever_and_travelling_load_are_textbook() -> None:
    bent, slope = physics_beams.cantilever(2.0, 3.0, 0.5, np.full(4001, 7.0))
    assert bent == pytest.approx((3 * 8 / 3 + 0.5 * 16 / 8) / 7, rel=1e-6)
    assert slope == pytest.approx((3 * 4 / 2 + 0.5 * 8 / 6) / 7, rel=1e-6)
    u = np.linspace(0, 1, 11)
    free, _ = physics_beams.travelling_load(u, 0.0)
    clamped, _ = physics_beams.travelling_load(u, 1.0)
    assert free == pytest.approx(u**2 * (1 - u) ** 2 / 3, abs=1e-12)
    assert clamped == pytest.approx(u**3 * (1 - u) ** 3 / 3, abs=1e-12)


def test_bar_comes_to_its_steady_state() -> None:
    """A fin: ``T = q cosh(m (1 - x)) / (m sinh m)``, m^2 the loss over the diffusion."""
    n, diffusion, loss = 4000, 4.5e-4, 9e-4
    bar = world.heat_bar(np.full(n, 5.0), np.zeros(n), nodes=101, diffusion=diffusion, loss=loss)
    m, x = np.sqrt(loss / diffusion), np.linspace(0, 1, 101)
    assert bar[-1] == pytest.approx(5.0 * np.cosh(m * (1 - x)) / (m * np.sinh(m)), rel=1e-4)


def test_friction_remembers_small_reversals() -> None:
    q = np.array([0.0, 10.0, 9.9, 0.0, 10.0])
    for force in (
        physics_drives.presliding(q, np.ones(5), 1.0, 2.0),
        physics_drives.plays(q, np.ones(5), np.array([1.0]), np.ones(1)),
    ):
        assert force[1] == pytest.approx(1, abs=0.02)  # slips after a long move
        assert 0.6 < force[2] < 0.95  # a tenth of the width back undoes little
        assert force[3] == pytest.approx(-1, abs=0.02)


def test_a_changed_truth_is_noticed(tmp_path: Path) -> None:
    seal = sealed(tmp_path / "t.json", {"effects": ["backlash"]})
    assert opened(tmp_path / "t.json", seal) == {"effects": ["backlash"]}
    (tmp_path / "t.json").write_text((tmp_path / "t.json").read_text().replace("backlash", "wobble"))
    with pytest.raises(BrokenSealError):
        opened(tmp_path / "t.json", seal)


@pytest.mark.long
def test_a_case_is_the_same_every_time(tmp_path: Path) -> None:
    spec = SPECS["mixture-000"]
    seals = [write(make(spec), tmp_path / name, tmp_path / f"{name}-sealed") for name in ("a", "b")]
    assert seals[0] == seals[1]
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


def test_the_list_of_cases_is_what_it_promises() -> None:
    kinds = pd.Series([s.kind for s in SPECS.values()]).value_counts()
    assert kinds.sum() >= 300
    assert kinds["empty"] >= 100
    assert kinds["mixture"] >= 30
    assert kinds["unnamed"] >= 30
    assert kinds["unseen"] >= 20
    assert len({s.topology for s in SPECS.values()}) >= 5
    empty = [s for s in SPECS.values() if s.kind == "empty"]
    assert {s.noise for s in empty} == {"white", "coloured", "tracker", "heavy"}
    assert {"poor", "grid", "lines", "levels", "oneway"} <= {s.plan for s in empty}


def test_scores_are_what_they_say() -> None:
    low, high = wilson(0, 100)
    assert low == 0
    assert high == pytest.approx(0.037, abs=0.001)
    truth = {
        "kind": "single",
        "effects": [{"effect": "backlash", "accept": ["backlash"], "where": ["X"]}],
        "tolerate": [],
    }
    said = [{"effect": n, "where": w, "probability": 0.9} for n, w in (("backlash", "Y"), ("wobble", "C"))]
    scored = Scored(truth, {"diagnosis": {"findings": said, "untestable": []}})
    (effect,) = scored.effects
    assert scored.named(effect)
    assert not scored.placed(effect)
    assert [f["effect"] for f in scored.false] == ["wobble"]
    error, chance, brier, count = calibration([scored])
    assert (error, brier, count) == pytest.approx((0.4, 0.41, 2))
    assert chance == pytest.approx(0.18, abs=0.03)  # 0.1, 0.4 and 0.9 with 0.81, 0.18 and 0.01


def test_a_name_that_cannot_be_told_from_the_truth_is_right_only_beside_it() -> None:
    effect = {"effect": "ram-sag", "accept": ["ram-sag"], "undecided": {"beam-sag": ["X"]}, "where": ["Y"]}
    said = {"effect": "beam-sag", "where": "Y", "alternatives": []}
    assert not says(said, effect)
    assert says(said | {"alternatives": [{"effect": "ram-sag", "where": "Y"}]}, effect)
    assert not says(said | {"effect": "wobble", "alternatives": [{"effect": "ram-sag", "where": "Y"}]}, effect)
    assert says(said | {"effect": "ram-sag"}, effect)
    assert not at(said, effect)  # as the truth is; beam-sag would be another member's
    assert at(said | {"where": "X"}, effect)
    assert not at(said | {"effect": "ram-sag", "where": "X"}, effect)


def test_coloured_noise_is_whitened_by_its_covariance() -> None:
    """A slow part of 300 s and a white one, drawn: white once whitened; a shift that lasts counts for less than in
    white noise of that size, one that comes and goes for more."""
    rng = np.random.default_rng(11)
    time, points = np.sort(rng.uniform(0, 6000, 300)), np.zeros((300, 3))
    noise = Noise("coloured", 0.002, tau=300.0, share=0.3)
    course = noise.course(time)
    white = [noise.whiten(points, course, noise.draw(points, time, rng)) for _ in range(40)]
    lags = [float(np.mean([w[k:] * w[: len(w) - k] for w in white])) for k in (0, 1, 5)]
    assert lags == pytest.approx([1, 0, 0], abs=0.02)  # 36000 values: three deviations
    lasting, coming = np.ones((300, 3)), np.where(np.arange(300) % 2, 1.0, -1.0)[:, None] * np.ones(3)
    size = [np.linalg.norm(noise.whiten(points, course, c)) * noise.sigma / 30 for c in (lasting, coming)]
    assert size[0] < 0.5
    assert size[1] > 1.1


def outcome(name: str, root: Path) -> Scored:
    """What the tool makes of a case, scored after its truth has been opened."""
    seal = write(make(SPECS[name]), root / "cases" / name, root / "sealed")
    run_case(root / "cases" / name, root / "results")
    result = json.loads((root / "results" / f"{name}.json").read_text())
    return Scored(opened(root / "sealed" / f"{name}.json", seal), result)


@pytest.mark.parametrize("rule", LEFT_OUT)
def test_a_rule_can_be_left_out(rule: str) -> None:
    """Each is a rule of the diagnosis, changes something while it is left out, and is there again afterwards."""
    assert rule in RULES
    for module, name, instead in LEFT_OUT[rule]:
        before = getattr(import_module(module), name)
        with left_out(rule):
            assert getattr(import_module(module), name) is instead is not before
        assert getattr(import_module(module), name) is before


@pytest.mark.long
def test_a_selection_of_the_cases(tmp_path: Path) -> None:
    """One test, in processes of its own: what counts are shares over many cases, not single ones."""
    names = (*EMPTY, *NAMED, *OTHER)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        found = dict(zip(names, pool.map(outcome, names, [tmp_path] * len(names)), strict=True))
    assert not {n: s.result["error"] for n, s in found.items() if s.broken}
    assert not [n for n, s in found.items() if s.worse]
    assert not {n: found[n].findings for n in EMPTY if found[n].findings}
    effects = [(found[n], e) for n in NAMED for e in found[n].effects]
    assert sum(s.named(e) for s, e in effects) >= len(effects) - 1
    assert sum(s.placed(e) for s, e in effects) >= len(effects) - 1
    assert np.median([x for n in NAMED if (x := found[n].excess) is not None]) < 0.1
    assert sum(bool(s.false_names) for s in found.values()) <= 1
    unseen = [s for s in found.values() if s.kind == "unseen"]
    assert all(s.truth["effects"][0]["absorbed"] > 0.99 for s in unseen)
    assert not any(s.findings for s in unseen)
    assert sum(s.said_untestable for s in unseen) >= len(unseen) - 1
    assert all(found["blunder-000"].named(e) for e in found["blunder-000"].effects)
    # of a few surveys, in each of which errors are alike: of a hundred it is 96 %, and of four it may be all
    assert np.concatenate([found[n].inside.ravel() for n in EMPTY]).mean() > 0.9


@pytest.mark.long
@pytest.mark.parametrize("effect", first_of(["rail-waviness", "tracker-drift"]))
def test_a_machine_of_fifty_millimetres_is_a_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, effect: str
) -> None:
    """Its effects are a twentieth of what is usual; six motions or waves are no worse an explanation for it."""
    small = 0.05

    def scaled(values: tuple[float, ...]) -> tuple[Any, ...]:
        return tuple(round(small * v, 6) for v in values)

    def build(rng: np.random.Generator) -> kinematics.Chain:
        chain = machines.bridge(rng)
        elements = [
            replace(e, offset=scaled(e.offset), travel=scaled(e.travel) if e.kind == "prismatic" else e.travel)
            for e in chain.elements
        ]
        return replace(chain, elements=tuple(elements), tools=tuple(map(scaled, chain.tools)))

    monkeypatch.setitem(machines.BUILDERS, "bridge-cmm", build)
    monkeypatch.setitem(machines.NOISE, "bridge-cmm", small * machines.NOISE["bridge-cmm"])
    monkeypatch.setitem(SPECS, effect, Spec(effect, "single", "bridge-cmm", "random", "white", (effect,), (30, 40), 7))
    told = outcome(effect, tmp_path)
    (finding,) = told.findings
    # or, where a member that warms up explains 30 standard uncertainties as well as a drift, what it may be, too
    open_names = {a["effect"] for a in finding["alternatives"] if (a["probability"] or 0) > 0.05}
    assert effect in {finding["effect"], *open_names}


def test_every_look_alike_has_a_form() -> None:
    rng = np.random.default_rng(5)
    chains = [machines.with_model(build(rng), 2) for build in machines.BUILDERS.values()]
    made = [build(chain, rng) for build in BUILDERS.values() for chain in chains]
    assert {name for hidden in made if hidden for name in hidden.also} <= set(FORMS)
    assert {hidden.effect for hidden in made if hidden} >= {"backlash", "ram-sag", "refraction", "joint-compliance"}
