"""What the command says of the coordinates that tables turn, and of controls that hold few of them, and writes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.controllers import registry
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from identification.compensation.conditions import Conditions, Largest
from identification.compensation.field import Field
from identification.compensation.options import check_most, with_load
from identification.estimation.fit import fit_machine
from identification.results.store import save
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, XYZ, done, run, write
from tests.helpers.surveys import measured, positions, survey

pytestmark = pytest.mark.usefixtures("few_poses")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a mill whose file counts in inches."""
    folder = tmp_path_factory.mktemp("mill") / "fit"
    machine = replace(read_machine(MILL), inches=True)
    table = positions(measured(machine, errors(Chain(machine), 3, 40.0, 60.0), 120, 4, noise=1e-3))
    save(fit_machine(machine, survey(table)), folder)
    return folder


def written(fitted: Path, folder: Path, name: str, *more: object) -> tuple[str, dict[str, Any]]:
    """What is printed, unwrapped, and ``compensation.json``."""
    out = done("compensate", fitted, "--controller", name, "--out", folder, *more).out
    return " ".join(out.split()), json.loads((folder / "compensation.json").read_text(encoding="utf-8"))


@pytest.mark.long
@pytest.mark.parametrize("name", ["csv", "fanuc-pitch", "klipper", "siemens-cec"])
def test_what_tables_turn_is_said_and_written(name: str, fitted: Path, tmp_path: Path) -> None:
    out, data = written(fitted, tmp_path / "a", name)
    (one,) = data["sets"]
    found = one["coordinates"]
    turn = " ".join(f"{round(v, 1) + 0.0:+.1f}" for v in found["turn_urad"])
    assert f"these tables turn the machine's coordinates by {turn} urad about x, y, z and move them by" in out
    assert np.isclose(found["left_um"], one["conditions"]["left_um"], rtol=1e-6)
    assert np.isclose(found["before_um"], one["conditions"]["before_um"], rtol=1e-6)
    matters = found["unaligned_um"] > 1.05 * found["left_um"] + 0.01 * found["before_um"]
    assert any("align again" in line for line in data["first"]) == matters == (name == "klipper")
    assert any("machine.yaml counts in inches" in line for line in data["first"])
    if matters:
        _, kept = written(fitted, tmp_path / "b", name, "--keep-alignment")
        other = kept["sets"][0]["coordinates"]
        assert other["unaligned_um"] < found["unaligned_um"]
        assert np.isclose(other["unaligned_um"], found["kept_um"], rtol=0.05)
        assert not any("align again" in line for line in kept["first"])


def test_scales_beside_the_tables_are_said_with_what_they_would_leave(fitted: Path, tmp_path: Path) -> None:
    out, data = written(fitted, tmp_path / "klipper", "klipper")
    assert f"with these scales set, and these tables: {data['scaled_um']:.1f} um rms are left" in out
    assert data["scaled_um"] < 0.95 * data["sets"][0]["conditions"]["left_um"]
    _, csv = written(fitted, tmp_path / "csv", "csv")
    assert [s["joint"] for s in csv["scales"]] == [s["joint"] for s in data["scales"]] != []
    assert csv["scaled_um"] is None  # its table holds them


@pytest.mark.long
def test_the_tables_that_gain_most_are_taken(fitted: Path, tmp_path: Path) -> None:
    left = {}
    for most in (2, 6, 12):
        out, data = written(fitted, tmp_path / str(most), "siemens-cec", "--max-tables", most)
        (one,) = data["sets"]
        used = len(one["tables"]) + len({t["factor"] for t in one["tables"] if t["factor"]})
        assert 0 < used <= most
        left[most] = one["conditions"]["left_um"]
        (line,) = one["notes"]
        assert line.startswith(f"{used} tables of the control, at most {most}: {left[most]:.1f} um rms are left; ")
        assert line in out
    assert left[12] < left[6] < left[2] < one["conditions"]["before_um"]
    _, whole = written(fitted, tmp_path / "all", "siemens-cec")
    assert any("tables of $AN_CEC are needed" in x and "--max-tables N" in x for x in whole["first"])
    assert whole["sets"][0]["conditions"]["left_um"] < left[12]
    with pytest.raises(InputError, match="--max-tables: plain CSV grid over all axes"):
        check_most(registry()["csv"](), 3)


def test_tables_are_for_the_load_that_is_given(fitted: Path, tmp_path: Path) -> None:
    """They were for the median of the survey's alone: an arm's programme left 213 um at 20 kg (14 with --load)."""
    text = (Path(__file__).resolve().parents[2] / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    machine = write(
        tmp_path / "m.yaml", f"{text}\neffects: [{{effect: payload-sag, joint: Y, motion: ea, degree: 0}}]\n"
    )
    truth = write(tmp_path / "t.yaml", "parameters: {Y.ea.payload-sag: 3e-6}\n")
    done("simulate", MILL, 80, "--out", tmp_path / "s.csv")
    poses = pd.read_csv(tmp_path / "s.csv").drop(columns=XYZ)
    poses.assign(load=np.where(np.arange(80) < 50, 0.0, 20.0)).to_csv(tmp_path / "poses.csv", index=False)
    how = ("--parameters", truth, "--noise", 0.001, "--out", tmp_path / "s.csv")
    done("simulate", machine, tmp_path / "poses.csv", *how)
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    out, usual = written(tmp_path / "fit", tmp_path / "usual", "csv", "--points", 3)
    _, loaded = written(tmp_path / "fit", tmp_path / "loaded", "csv", "--load", 20, "--points", 3)
    assert (usual["load"], loaded["load"]) == (0.0, 20.0)
    assert "load: 0 kg (another: --load)" in out
    before = [x["sets"][0]["figures"][0]["before"]["rms_um"] for x in (usual, loaded)]
    after = [x["sets"][0]["figures"][0]["after"]["rms_um"] for x in (usual, loaded)]
    assert before[0] < 2 < 5 < before[1]
    assert max(after) < 1
    of_fit = Field.without_errors(Chain(read_machine(machine)), pd.read_csv(tmp_path / "poses.csv"))
    under, (note,) = with_load(of_fit, 50.0, pd.read_csv(tmp_path / "poses.csv"))
    assert under.state["load"] == 50
    assert "a load of 50 kg lies beyond those of the survey, 0 to 20 kg" in note
    for fit, load, found in ((fitted, 20, "no effect of the model depends on a load"), (tmp_path / "fit", -1, "-1 kg")):
        wrong = run("compensate", fit, "--controller", "csv", "--out", tmp_path / "no", "--load", load)
        assert wrong.code == 2
        assert found in wrong.err


def test_do_not_load_names_the_condition_with_enough_digits() -> None:
    size = Largest(0.1, "X", "", 0.0, "X")
    said = Conditions(80.04, None, None, 100.0, 0.05, size).against("csv")
    assert said.startswith(
        "this format takes away 19.96 % of the rms error (100.0 um before, 80.0 after), less than 20 %"
    )
    assert "worse" not in said
    said = Conditions(50.0, None, None, 100.0, 0.1004, size).against("csv")
    assert said.startswith("it makes 10.04 % of the poses worse, more than 10 %; ")
    both = Conditions(101.0, None, None, 100.0, 0.6, size).against("csv")
    assert "takes away nothing" in both
    assert "and it makes 60 % of the poses worse" in both
    assert Conditions(80.0, None, None, 100.0, 0.1, size).against("csv") == ""
