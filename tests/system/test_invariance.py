"""What a survey says of a machine does not depend on units, on the order of rows, on the frame, nor on names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError
from errormodel.machine import Basis, Joint, Machine, Shape
from errormodel.simulation import measured_at, outward, random_points
from errormodel.survey import read_survey
from errormodel.truth import Truth
from identification.estimation.fit import fit_machine
from tests.helpers.chains import errors, machines, unit
from tests.helpers.commands import XYZ

ROWS = 60
# um: readings are rounded in their tenth digit where they change unit or frame, and iterations end at 1e-9 of a step
SAME_UM = 1e-6
# one arc of 46 deg: the fit is so open that it ran 0.4 m away, or not, as the order of the rows would have it
ARC = Machine(
    "arc",
    (
        Shape("S", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), MOTIONS),
        Joint(
            "J", "rotary", unit((-2, -2, 0)), (-1.7, -0.9),
            {
                "ea": Basis("spline", 2), "eb": Basis("polynomial", 4), "ec": Basis("first-order"),
                "dx": Basis("spline", 2), "dy": Basis("first-order"), "dz": Basis("first-order"),
            },
        ),
    ),
    (-510.0, 180.0, 680.0),
)  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("invariance")


def recording(machine: Machine) -> pd.DataFrame:
    """Commands in the units of files, and what a noisy instrument saw there."""
    chain = Chain(machine)
    commands = random_points(machine, ROWS, 1)
    values = errors(chain)
    truth = Truth({i: float(values[chain.index[i]]) for i in chain.machine_ids})
    commands[XYZ] = measured_at(machine, commands, truth, 0.002)[XYZ]
    return outward(commands, machine)


def fitted(machine: Machine, table: pd.DataFrame, place: Path, units: str = "") -> tuple[int, float, float, bool]:
    """Rank, root mean square of the nominal and the fitted residuals (um), and whether points determine the frame."""
    table.to_csv(place / "s.csv", index=False)
    text = f"errormodel: 1\nfiles: [{{path: s.csv}}]\n{units}"
    (place / "s.yaml").write_text(text)
    fit = fit_machine(machine, read_survey(place / "s.yaml", machine))
    known = not any(len(pose.undetermined) for pose in fit.problem.frames.values())
    return fit.solution.groups.rank, fit.nominal.rms_um, fit.fitted.rms_um, known


def renamed(machine: Machine) -> tuple[Machine, dict[str, str]]:
    """The machine with other names, in another order of the alphabet."""
    names = {e.name: f"Q{len(machine.elements) - k}_" for k, e in enumerate(machine.elements)}
    elements = tuple(replace(e, name=names[e.name]) for e in machine.elements)
    return replace(machine, elements=elements), {j: n for j, n in names.items() if j in table_names(machine)}


def table_names(machine: Machine) -> list[str]:
    return [e.name for e in machine.elements if isinstance(e, Joint)]


@pytest.mark.long
@given(machine=machines(most_joints=3), seed=st.integers(0, 99))
@example(machine=ARC, seed=0)
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
def test_units_order_frame_and_names(machine: Machine, seed: int, place: Path) -> None:
    table = recording(machine)
    try:
        rank, nominal, left, known = fitted(machine, table, place)
    except InputError:  # a chain of which this survey shows nothing
        assume(False)
    rng = np.random.default_rng(seed)
    moved = table.copy()
    # a rotation that the points do not determine is as survey.yaml says, and no other
    turn = Rotation.from_rotvec(rng.normal(0, 1, 3) if known else np.zeros(3))
    moved[XYZ] = turn.apply(table[XYZ].to_numpy(copy=True)) + rng.uniform(-1e4, 1e4, 3)
    metres = table.copy()
    linear = [j.name for j in machine.joints if j.type == "prismatic"]
    metres[[*linear, *XYZ, "tool_x", "tool_y", "tool_z"]] /= 1e3
    other, names = renamed(machine)
    again = {
        "order": fitted(machine, table.iloc[rng.permutation(ROWS)], place),
        "frame": fitted(machine, moved, place),
        "units": fitted(machine, metres, place, "units: {length: m}\n"),
        "names": fitted(other, table.rename(columns=names), place),
    }
    for what, (its_rank, its_nominal, its_left, _) in again.items():
        assert its_rank == rank, what
        assert its_nominal == pytest.approx(nominal, abs=SAME_UM), what
        assert its_left == pytest.approx(left, abs=SAME_UM), what
