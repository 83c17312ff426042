"""Readings of the opposite sign beside points or other observations: found, put right, and right ones left alone.

Surveys are simulated elsewhere, or by the product's own readings: mirrored about a machine without errors.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.simulation_readings import readings_at
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.diagnosis.data_checks.gate import passed
from identification.diagnosis.data_checks.opposite_readings import find_opposite_readings
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from tests.helpers.lengths import commands, entry, survey, truth

MACHINE = read_machine("vertical_three_axis")
CHAIN = Chain(MACHINE)
JOINTS = [j.name for j in MACHINE.joints]
NOISE = {"length": 5e-4, "angle": 5e-7}  # mm, rad
POINTS = 3e-3  # mm, of a coordinate
KINDS: dict[str, tuple[dict[str, object], dict[str, float]]] = {
    "pose-distance": ({}, {}),
    "station-distance": ({"near": [900.0, -700.0, -200.0]}, {"x": 900.0, "y": -700.0, "z": -200.0}),
    "line-angle": ({"axis": [0.0, 1.0, 0.0]}, {"zero": 1e-5}),
    "precision-level": ({"axis": [1.0, 0.0, 0.0]}, {"zero": 1e-5}),
    "ballbar-circle": ({"calibrated": 150.0}, {}),
    "touched-plane": ({"normal": [0.0, 0.0, 1.0]}, {"tilt_1": 1e-4, "tilt_2": -1e-4, "zero": 0.0}),
}
SEEDS = (2, 3)


def at(word: str, rng: np.random.Generator) -> pd.DataFrame:
    """Commands of an observation: all over the travels, or bound to a circle or a plane."""
    table = commands(MACHINE, 90, rng)
    middle = {j.name: sum(j.travel) / 2 for j in MACHINE.joints}
    if word == "pose-distance":
        table = table.join(commands(MACHINE, 90, rng).add_prefix("from_"))
    elif word == "ballbar-circle":
        angle = np.linspace(0, 2 * np.pi, 90)
        table = table.assign(**middle).assign(X=middle["X"] + 150 * np.cos(angle), Y=middle["Y"] + 150 * np.sin(angle))
    elif word == "touched-plane":
        table["Z"] = middle["Z"]
    return table


def mixed(
    words: dict[str, str], turned: str = "", hidden: float = 0.0, seed: int = 1, points: int = 150, **keys: object
) -> Survey:
    """Points of a machine with random errors, and observations by label; those of `turned` have the opposite sign.

    `hidden` (mm) is the amplitude of a cyclic error of X that the machine's file lacks.
    """
    rng = np.random.default_rng(seed)
    values = truth(MACHINE, rng)
    parts, entries = [], {}
    for label, word in {"": "", **words}.items():
        table = at(word, rng) if word else commands(MACHINE, points, rng)
        table = table.assign(observation=label, run="1")
        table = table.assign(**{f"tool_{a}": v for a, v in zip("xyz", MACHINE.tool, strict=True)})
        true = table.assign(X=table["X"] + hidden * np.sin(2 * np.pi * table["X"] / 37))
        if not word:  # targets of two lengths show rotations
            table["tool_z"] = true["tool_z"] = table["tool_z"] - 200.0 * (np.arange(points) % 2)
            rows = CHAIN.columns(true)
            place = CHAIN.kernel("actual", outputs=(0, 1, 2))(rows, CHAIN.vector(values)).T
            place += rng.normal(0, POINTS, place.shape)
            parts.append(table.assign(**dict(zip(("mx", "my", "mz"), place.T, strict=True))))
            continue
        options, set_up = KINDS[word]
        nominal = CHAIN.kernel("nominal", outputs=(0, 1, 2))(CHAIN.columns(table))
        if word == "ballbar-circle":
            middle = (nominal.max(axis=1) + nominal.min(axis=1)) / 2
            set_up = dict(zip("xyz", (middle + rng.normal(0, 0.02, 3)).tolist(), strict=True))
        if word == "touched-plane":
            set_up = {**set_up, "zero": float(nominal[2].mean())}
        model = entries[label] = entry(type=word, **options, **keys)
        read, right = (
            readings_at(CHAIN, t, {label: model}, Truth(v, set_ups={label: set_up}))[model.reading]
            for t, v in ((true, values), (table, {}))
        )
        read = read + rng.normal(0, NOISE[model.reading], len(read))
        parts.append(table.assign(**{model.reading: 2 * right - read if label in turned else read}))
    return survey(MACHINE, pd.concat(parts if points else parts[1:], ignore_index=True), entries)


@pytest.mark.parametrize("hidden", [0.0, 0.004])
@pytest.mark.parametrize("word", KINDS)
def test_the_opposite_sign_of_each_kind_is_found_and_mirrored_and_the_right_one_is_not(
    word: str, hidden: float
) -> None:
    for seed in SEEDS:
        right, turned = (mixed({"A": word}, t, hidden, seed) for t in ("", "A"))
        assert find_opposite_readings(CHAIN, right) is None
        found = find_opposite_readings(CHAIN, turned)
        assert found is not None, seed
        assert found.text.startswith("the readings of observation A have the opposite sign")
        assert find_opposite_readings(CHAIN, found.survey) is None
        assert len(found.rows or ()) == 90
        if not hidden:
            sigma = fit_machine(MACHINE, found.survey).solution.sigma[word]
            assert sigma == pytest.approx(NOISE[entry(type=word, **KINDS[word][0]).reading], rel=0.4)


@pytest.mark.parametrize("sigma", [[5e-4, 0.0], [5e-3, 0.0], [5e-5, 0.0]])
def test_a_declared_noise_does_not_matter(sigma: list[float]) -> None:
    log = DecisionLog()
    find_opposite_readings(CHAIN, mixed({"A": "pose-distance"}, "A", sigma=sigma), log)
    plain = DecisionLog()
    find_opposite_readings(CHAIN, mixed({"A": "pose-distance"}, "A"), plain)
    values = [[d.value for d in own if d.rule == "reading-opposite-sign"] for own in (log, plain)]
    assert values[0] == pytest.approx(values[1], rel=1e-3)


def test_all_observations_of_the_opposite_sign_are_found_at_once() -> None:
    words = {"A": "pose-distance", "B": "pose-distance", "C": "station-distance"}
    found = find_opposite_readings(CHAIN, mixed(words, "AB"))
    assert found is not None
    assert found.text.startswith("the readings of observations A, B have the opposite sign")


def test_readings_alone_say_nothing_of_their_sign() -> None:
    """All signs turned are another machine: as likely as this one."""
    for turned in ("", "A"):
        assert find_opposite_readings(CHAIN, mixed({"A": "pose-distance"}, turned, points=0)) is None
    assert find_opposite_readings(CHAIN, mixed({"A": "pose-distance", "B": "pose-distance"}, "AB", points=0)) is None


def test_of_two_observations_that_contradict_each_other_neither_is_taken_for_wrong() -> None:
    with pytest.raises(InputError, match=r"observations A, B contradict .* Which of them is wrong they do not tell"):
        find_opposite_readings(CHAIN, mixed({"A": "pose-distance", "B": "pose-distance"}, "A", points=0))


def test_of_three_the_odd_one_is_found() -> None:
    found = find_opposite_readings(CHAIN, mixed(dict.fromkeys("ABC", "pose-distance"), "B", points=0))
    assert found is not None
    assert found.text.startswith("the readings of observation B have the opposite sign")


@pytest.mark.parametrize("robust", [False, True])
def test_a_fit_refuses_and_says_what_to_write(robust: bool) -> None:
    wrong = mixed({"A": "ballbar-circle"}, "A")
    words = (
        r"observation A have the opposite sign: they lie .* um rms from what the rest shows as they are, .* um mirrored"
    )
    with pytest.raises(InputError, match=words) as error:
        passed(MACHINE, wrong, lambda: fit_machine(MACHINE, wrong, robust), robust)
    assert "the bar is longer than its calibrated length. `errormodel diagnose` puts it right" in str(error.value)
    right = mixed({"A": "ballbar-circle"})
    passed(MACHINE, right, lambda: fit_machine(MACHINE, right, robust), robust)


def test_a_diagnosis_puts_it_right_and_says_so() -> None:
    done = diagnose(MACHINE, mixed({"A": "pose-distance"}, "A"))
    (finding,) = done.diagnosis.findings
    assert finding.effect == "axis-blunder"
    assert finding.driver == ["length"]
    assert "they are taken mirrored" in finding.statement
    assert done.diagnosis.verdict == "explained"
    assert done.final.solution.sigma["pose-distance"] == pytest.approx(NOISE["length"], rel=0.3)
    assert next(d.outcome for d in done.log if d.rule == "reading-opposite-sign") == "found"
