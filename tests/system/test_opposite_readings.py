"""Readings of the opposite sign beside points or other observations: found, put right, and right ones left alone.

Surveys are simulated elsewhere, or by the product's own readings: mirrored about a machine without errors.
"""

from __future__ import annotations

import pytest

from errormodel.exceptions import InputError
from identification.diagnosis.data_checks.gate import passed
from identification.diagnosis.data_checks.opposite_readings import find_opposite_readings
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from tests.helpers.lengths import entry
from tests.helpers.mixed import CHAIN, KINDS, MACHINE, NOISE, mixed

SEEDS = (2, 3)


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
