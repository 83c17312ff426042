"""What every observation model keeps to: words and units of its keys, derivatives that are some, unknowns recovered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from errormodel.observation_kernel import kernels_of
from errormodel.observations import registry
from errormodel.observations.base import Observation
from errormodel.simulation import simulate
from errormodel.simulation_readings import readings_at
from errormodel.survey import Survey, read_survey
from errormodel.truth import Truth
from errormodel.yamlfile import flow
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from tests.helpers.lengths import commands, standardised, truth
from tests.helpers.lengths import survey as survey_of
from tests.helpers.nightly import first_of

KINDS = registry()
STEPS = {"mm": 1e-2, "rad": 1e-4, "1": 1e-4, "rad/mm": 1e-7}
MACHINES = ("vertical_three_axis", "trunnion_five_axis", "six_axis_arm")


def example(word: str) -> Observation:
    return KINDS[word](type=word, **KINDS[word].example)


def made(
    word: str, machine_name: str = "vertical_three_axis", rows: int = 60, noise: float = 0.0
) -> tuple[Survey, dict[str, float]]:
    """Readings of the example at random poses of a machine with random errors, and the true unknowns."""
    machine, rng = read_machine(machine_name), np.random.default_rng(4)
    observation, values = example(word), truth(machine, rng)
    table = commands(machine, rows, rng)
    if observation.poses > 1:
        table = table.join(commands(machine, rows, rng).add_prefix("from_"))
    table = table.assign(observation="A", run="1", **{f"tool_{a}": v for a, v in zip("xyz", machine.tool, strict=True)})
    read = readings_at(Chain(machine), table, {"A": observation}, Truth(values))
    column = read[observation.reading] + noise * rng.standard_normal(rows)
    return survey_of(machine, table.assign(**{observation.reading: column}), {"A": observation}), values


@pytest.mark.parametrize("word", KINDS)
def test_says_what_it_is_what_it_sees_and_the_unit_of_every_key(word: str) -> None:
    kind = KINDS[word]
    assert kind.__doc__
    assert kind.source
    assert kind.sees
    assert get_args(kind.model_fields["type"].annotation) == (word,)
    units = ("mm", "rad", "mm/mm", "1")
    for name, field in kind.model_fields.items():
        if name != "type":
            text = (field.description or "").replace(",", " ").replace(";", " ").replace(":", " ")
            assert set(units) & set(text.split()), name


@pytest.mark.parametrize("word", KINDS)
def test_quantities_keep_their_order_and_those_of_a_point_exist(word: str) -> None:
    observation = example(word)
    names = [q.name for q in observation.quantities()]
    assert len(set(names)) == len(names)
    assert {*observation.point} <= {*names}
    assert all(q.unit in ("mm", "rad", "1") for q in observation.quantities())


@pytest.mark.parametrize("machine_name", first_of(MACHINES))
@pytest.mark.parametrize("word", KINDS)
def test_derivatives_are_those_of_the_reading(word: str, machine_name: str) -> None:
    """By parameters, by quantities of the set-up and by levers: central differences of the exact reading."""
    survey, values = made(word, machine_name, rows=25)
    machine = read_machine(machine_name)
    chain, observation = Chain(machine), survey.observations["A"]
    (view,) = _views(chain, survey)
    kernels = kernels_of(chain, observation)
    free = tuple(q.name for q in observation.free)
    units = [p.unit for p in chain.parameters] + [q.unit for q in observation.free]
    for what, at in (("design", {}), ("linearised", values)):
        scalars = view.vector({}, np.zeros(0), chain.vector(at))
        slopes = kernels.kernel(what, chain.ids, free)(view.rows, scalars)  # type: ignore[arg-type]
        for k, name in enumerate((*chain.ids, *free)):
            place = k if k < len(chain.ids) else len(chain.ids) + kernels.names.index(name)
            # the reading changes by 10 um at most, and a rotation by some 100 urad
            size = min(1e-2 / np.abs(slopes[k]).max(initial=1.0), STEPS[units[k]])
            ahead, back = scalars.copy(), scalars.copy()
            ahead[place] += size
            back[place] -= size
            value = kernels.kernel("value")
            found = (value(view.rows, ahead) - value(view.rows, back))[0] / (2 * size)
            # differences are good to 1e-9: round-off of a reading of a metre over its change, and the step squared
            np.testing.assert_allclose(slopes[k], found, rtol=1e-6, atol=1e-6 * max(1.0, np.abs(found).max()))


def _views(chain: Chain, survey: Survey):  # type: ignore[no-untyped-def]
    from identification.observation.assembly import build

    return build(chain, survey).readings


@pytest.mark.long
@pytest.mark.parametrize("word", KINDS)
def test_a_fit_recovers_every_group_and_unknown(word: str) -> None:
    """Readings with noise: all groups lie within five standard uncertainties of the truth, and most within two."""
    noise = 1e-4 if KINDS[word].reading == "length" else 1e-7
    survey, values = made(word, rows=300, noise=noise)
    machine = read_machine("vertical_three_axis")
    fit = fit_machine(machine, survey)
    known = _true_unknowns(fit, word)
    z = np.array([*standardised(fit, {**values, **known}).values()])
    assert len(z) >= 3
    assert np.abs(z).max() < 5
    assert np.mean(np.abs(z) < 2) > 0.7
    assert 0.8 < fit.solution.sigma[word] / noise < 1.2  # 300 readings know their noise to 4 %


def _true_unknowns(fit: Fit, word: str) -> dict[str, float]:
    """The unknowns that the simulation assumed."""
    observation = example(word)
    (view,) = fit.problem.readings
    each = len(view.chain.channels)
    nominal = view.chain.kernel("nominal", (), {}, (0, 1, 2))
    points = [nominal(view.rows[k : k + each]).T for k in range(0, len(view.rows), each)]
    known = {q.name: q.value for q in observation.quantities() if q.value is not None}
    assumed = dict.fromkeys(view.free, 0.0) | observation.assumed(points, known)
    return {column: assumed[name] for name, column in zip(view.free, view.starts, strict=True)}


@pytest.mark.parametrize("word", KINDS)
def test_a_survey_file_keeps_it(word: str, tmp_path: Path) -> None:
    observation = example(word)
    machine = read_machine("vertical_three_axis")
    table = commands(machine, 12, np.random.default_rng(0)).assign(observation="A")
    if observation.poses > 1:
        table = table.join(commands(machine, 12, np.random.default_rng(1)).add_prefix("from_"))
    table.to_csv(tmp_path / "commands.csv", index=False)
    block = flow(observation.model_dump(exclude_none=True))
    text = f"errormodel: 1\nfiles: [{{path: FILE.csv}}]\nobservations: {{A: {block}}}\n"
    (tmp_path / "commands.yaml").write_text(text.replace("FILE", "commands"))
    read = read_survey(tmp_path / "commands.yaml", machine, measured=False)
    assert read.observations["A"] == observation
    simulated = simulate(machine, read, noise=1e-4, seed=3)
    assert np.isfinite(simulated[observation.reading]).all()
    assert not {"mx", "my", "mz"} & {*simulated.columns}
    simulated.to_csv(tmp_path / "data.csv", index=False)
    (tmp_path / "survey.yaml").write_text(text.replace("FILE", "data"))
    again = read_survey(tmp_path / "survey.yaml", machine)
    np.testing.assert_allclose(again.table[observation.reading], simulated[observation.reading], rtol=1e-12)


@pytest.mark.parametrize("word", KINDS)
def test_declared_uncertainties_and_noise_agree(word: str) -> None:
    observation = replace_sigma(example(word), [3e-4, 0.0])
    machine = read_machine("vertical_three_axis")
    survey, _ = made(word, rows=4000)
    table = survey.table
    exact = readings_at(Chain(machine), table, {"A": observation}, Truth({}))[observation.reading]
    noisy = readings_at(Chain(machine), table, {"A": observation}, Truth({}), noise="instrument")[observation.reading]
    assert abs(np.std(noisy - exact) / 3e-4 - 1) < 0.06  # five standard errors of 4000 draws


def replace_sigma(observation: Observation, sigma: list[float]) -> Observation:
    return observation.model_copy(update={"sigma": sigma})


@pytest.mark.parametrize("word", KINDS)
def test_rows_may_be_taken_apart(word: str) -> None:
    """A part of a view predicts what the whole does there."""
    survey, values = made(word, rows=30)
    chain = Chain(read_machine("vertical_three_axis"))
    (view,) = _views(chain, survey)
    p = view.vector({}, np.zeros(0), chain.vector(values))
    whole = np.hstack([g for _, g in view.gaps(p)])
    rows = np.array([3, 17, 29])
    part = replace(view.part(rows))
    np.testing.assert_array_equal(np.hstack([g for _, g in part.gaps(p)]), whole[:, rows])
