"""What `fit` says of an axis that goes farther or less far than any screw, and `check` of lengths of several runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification.diagnosis.data_checks.readings import Lengths, length_lines
from identification.estimation.fit import fit_machine
from identification.estimation.large_scales import large_scales
from tests.helpers.chains import errors
from tests.helpers.commands import MILL, done
from tests.helpers.surveys import measured, positions, survey


@pytest.mark.parametrize("travelled", [1.001, 0.999])
def test_a_scale_that_no_machine_has_is_said(travelled: float, tmp_path: Path) -> None:
    """1 mm in a metre passed without doubt; that of usual errors is none."""
    done("simulate", MILL, 80, "--noise", 0.002, "--out", tmp_path / "s.csv")
    table = pd.read_csv(tmp_path / "s.csv")
    table.assign(Y=table["Y"] / travelled).to_csv(tmp_path / "off.csv", index=False)
    said = done("fit", MILL, tmp_path / "off.csv", "--out", tmp_path / "off").err
    way = "far" if travelled > 1 else "short"
    assert re.search(rf"note: Y goes (0.99\d?|1|1.01) mm too {way} in a metre \(\+- 0.0\d+\), more than", said)
    assert "a pitch or steps a mm that are set wrong" in said
    assert "in a metre" not in done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit").err


def test_usual_errors_are_no_such_scale() -> None:
    machine = read_machine(MILL)
    table = positions(measured(machine, errors(Chain(machine), 3, 40.0, 60.0), 80, 1, noise=2e-3))
    assert not list(large_scales(fit_machine(machine, survey(table))))


def test_lengths_of_several_runs_name_the_run() -> None:
    """A line a run did not say which; displacements across a line were called lengths, too long for a scale."""
    machine = read_machine(MILL)
    rows = positions(measured(machine, np.zeros(len(Chain(machine).ids)), 24, 1)).assign(run=["a"] * 12 + ["b"] * 12)
    own, gap = survey(rows), np.full(12, 0.01)
    first, second = np.arange(12), np.arange(12, 24)
    none = np.zeros(0, dtype=np.intp)
    lines = list(length_lines(own, [Lengths("LX", k, gap, none, ()) for k in (first, second)]))
    assert [line.split(":")[0] for line in lines] == ["LX, run a", "LX, run b"]
    assert "nearly all of them too long: a scale" in lines[0]
    (line,) = length_lines(own, [Lengths("SXy", first, gap, none, (), long=False)])
    assert line.startswith("SXy: 12 readings, 10 um rms")
    assert "too long" not in line
