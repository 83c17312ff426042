"""`errormodel monitor` with a model of which an effect belongs to one run of its survey."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.files import write_csv
from tests.helpers.commands import done, run, write
from tests.helpers.machine_files import GANTRY


def test_an_effect_of_one_run_is_not_there_in_cycles_of_others(tmp_path: Path) -> None:
    """All such cycles were refused, "a run that no fitted row is of"; a fit of them still is."""
    own = write(
        tmp_path / "m.yaml", f"{GANTRY}effects: [{{effect: compensation-active, joint: X, points: 3, run: on}}]\n"
    )
    plain = write(tmp_path / "plain.yaml", GANTRY)
    done("simulate", plain, 90, "--noise", 0.002, "--out", tmp_path / "simulated.csv")
    table = pd.read_csv(tmp_path / "simulated.csv")
    write_csv(table.assign(run=np.where(np.arange(90) < 45, "off", "on")), tmp_path / "s.csv")
    done("fit", own, tmp_path / "s.csv", "--out", tmp_path / "fit")
    for number in (1, 2):
        write_csv(table.iloc[number::2].assign(run="off"), tmp_path / f"{number}.csv")
        result = run("monitor", tmp_path / "fit", tmp_path / f"{number}.csv")
        assert result.code == 0
        assert "not shown by this cycle: 3 of" in result.out
        assert "(X.dx.compensation-active-0, X.dx.compensation-active-1, X.dx.compensation-active-2)" in result.out
    assert "a run that no fitted row is of" in run("fit", own, tmp_path / "1.csv", "--out", tmp_path / "no").err
