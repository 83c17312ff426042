"""A result of version 1 is read for ever."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from identification.results import manifest
from tests.helpers.commands import done

HERE = Path(__file__).parent / "version_1"
OURS = ["mx", "my", "mz", "ex", "ey", "ez", "ux", "uy", "uz"]
CLOSE_MM = 1e-9  # what order of summation may change; a thousandth of what any instrument resolves


def test_predictions_of_an_old_result_are_the_old_ones(tmp_path: Path) -> None:
    done("predict", HERE / "fit", HERE / "points.csv", "--out", tmp_path / "p.csv")
    new, old = (pd.read_csv(p) for p in (tmp_path / "p.csv", HERE / "expected.csv"))
    assert [*new] == [*old]
    np.testing.assert_allclose(new[OURS], old[OURS], rtol=0, atol=CLOSE_MM)


def test_the_other_readers_take_it(tmp_path: Path) -> None:
    shutil.copytree(HERE / "fit", tmp_path / "fit")
    assert manifest.read(tmp_path / "fit") is not None
    done("compensate", tmp_path / "fit", "--controller", "csv", "--points", 3, "--out", tmp_path / "t")
    done("simulate", tmp_path / "fit", 12, "--noise", 0.001, "--out", tmp_path / "cycle.csv")
    assert "cycle 1" in done("monitor", tmp_path / "fit", tmp_path / "cycle.csv").out
