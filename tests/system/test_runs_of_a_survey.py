"""Several runs in one fit: what they share and what each has for itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.machine_file import read_machine, write_machine
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from tests.helpers.chains import Array, errors
from tests.helpers.commands import XYZ, done
from tests.helpers.surveys import measured, positions, prediction_of, survey

MACHINE = read_machine("trunnion_five_axis")
CHAIN = Chain(MACHINE)
P = errors(CHAIN, 1)
OWN = """effects:
  - {effect: unnamed, element: X, motion: dx, driver: X, half_range: 1000, by: run(evening)}
  - {effect: unnamed, element: tool, motion: dz, driver: run(evening)}
"""
REACH = max(abs(t) for j in MACHINE.joints if j.name == "X" for t in j.travel)  # of its polynomials
SCALE, TOOL, NOISE = 60e-6, -0.015, 2e-3  # in the evening the scale is longer and the tool shorter, mm
ELSEWHERE = ((-700.0, 900.0, 30.0), (0.0, 0.2, -1.0))


def evening() -> tuple[Array, dict[str, object]]:
    """Its errors, and how it was measured."""
    p = P.copy()
    p[CHAIN.index["X.dx.1"]] += SCALE * REACH
    return p, {"tools": ((*MACHINE.tool[:2], MACHINE.tool[2] + TOOL),), "frame": ELSEWHERE, "run": "evening"}


def runs(noise: float = NOISE, rows: int = 70) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Morning and evening, each from a station of its own."""
    p, how = evening()
    tables = measured(MACHINE, P, rows, 1, noise, run="morning"), measured(MACHINE, p, rows, 2, noise, **how)  # type: ignore[arg-type]
    tables[1][["tool_x", "tool_y", "tool_z"]] = MACHINE.tool  # nobody wrote down that it is another one
    return positions(tables[0]), positions(tables[1])


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Machine]:
    """The machine with the text of its effects, as a user writes it."""
    path = tmp_path_factory.mktemp("runs") / "m.yaml"

    def read(text: str) -> Machine:
        write_machine(MACHINE, path)
        path.write_text(path.read_text() + text)
        return read_machine(str(path))

    return read


def own_values(fit: Fit) -> tuple[Array, Array]:
    """Estimates and standard uncertainties of what the evening has for itself."""
    names = [i for ids in fit.chain.effect_ids for i in ids]
    s = fit.solution
    places = [s.groups.base.tolist().index(s.unknowns.index(n)) for n in names]
    return np.array([s.named()[n] for n in names]), np.sqrt(np.diag(s.covariance))[places]


def test_own_parameters_and_frames_beside_common_ones(machine: Callable[[str], Machine]) -> None:
    """Each run has its frame; the scale and the tool of the second are found, the rest stays common."""
    fit = fit_machine(machine(OWN), survey(*runs(), frame="per-run"))
    assert set(fit.problem.frames) == {"morning", "evening"}
    assert fit.solution.sigma["position"] == pytest.approx(NOISE, rel=0.12)
    values, std = own_values(fit)
    assert (np.abs(values - [1000 * SCALE, TOOL]) < 3.5 * std).all()
    assert (std < 3e-3).all()
    common = fit_machine(MACHINE, survey(*runs(), frame="per-run"))
    assert common.fitted.rms_um > 2 * fit.fitted.rms_um


def test_each_run_is_predicted_with_its_own(machine: Callable[[str], Machine]) -> None:
    fit = fit_machine(machine(OWN), survey(*runs(0.0), frame="per-run"))
    p, how = evening()
    assert prediction_of(fit, positions(measured(MACHINE, P, 40, 8, run="morning"))) < 0.01
    table = positions(measured(MACHINE, p, 40, 9, **how))  # type: ignore[arg-type]
    table[["tool_x", "tool_y", "tool_z"]] = MACHINE.tool
    assert prediction_of(fit, table) < 0.01


def test_a_run_that_never_was_is_told(machine: Callable[[str], Machine]) -> None:
    with pytest.raises(InputError, match=r"run\(evning\).*evening, morning"):
        fit_machine(machine(OWN.replace("run(evening)", "run(evning)")), survey(*runs(), frame="per-run"))


@pytest.mark.long
def test_commands(machine: Callable[[str], Machine], tmp_path: Path) -> None:
    """From files to predictions, as a user has it."""
    write_machine(machine(OWN), tmp_path / "m.yaml")
    for table, name in zip(runs(), ("morning", "evening"), strict=True):
        table[["A", "C"]] = np.degrees(table[["A", "C"]])
        table.drop(columns=["file", "role", "row"]).to_csv(tmp_path / f"{name}.csv", index=False)
    (tmp_path / "s.yaml").write_text(
        "errormodel: 1\nframe: per-run\nfiles: [{path: morning.csv, role: fit}, {path: evening.csv, role: fit}]\n"
    )
    done("fit", tmp_path / "m.yaml", tmp_path / "s.yaml", "--out", tmp_path / "fit")
    done("predict", tmp_path / "fit", tmp_path / "evening.csv", "--out", tmp_path / "p.csv")
    told, seen = pd.read_csv(tmp_path / "p.csv"), pd.read_csv(tmp_path / "evening.csv")
    assert np.abs((told[XYZ] - seen[XYZ]).to_numpy()).max() < 5 * NOISE
