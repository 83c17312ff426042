"""What the other commands do on a fleet: effects in common, cycles of monitored machines, figures of standards."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from identification import fleet
from identification.plots.fleet import draw_matrix
from tests.helpers.commands import MILL, done, write
from tests.helpers.fleets import fleet_of, mill_fleet


@pytest.mark.long
def test_diagnose_says_what_types_have_in_common(tmp_path: Path) -> None:
    """The mill of the README, with play of X: in all machines of one type, and in one machine of another."""
    from dataclasses import replace

    from errormodel import read_machine, simulate
    from errormodel.machine import EffectSpec

    worn = replace(read_machine(MILL), effects=(EffectSpec("backlash", {"joint": "X"}),))
    lines = ["machine,survey,id,type"]
    for kind in "AB":
        for i in range(5):
            play = kind == "A" or i == 3
            table = simulate(worn if play else MILL, 60, {"X.dx.backlash": 0.012} if play else {}, noise=0.002, seed=i)
            write(tmp_path / f"{kind}{i}.csv", table.to_csv(index=False))
            lines.append(f"{MILL},{kind}{i}.csv,{kind}{i},{kind}")
    result = fleet_of(tmp_path, "\n".join(lines) + "\n", "--command", "diagnose")
    assert result.code == 0, result.err
    assert "A: backlash at X in 5 of 5 machines" in result.out
    machines = pd.read_csv(tmp_path / "out/machines.csv").set_index("id")
    assert list(machines.index[machines["out"]]) == ["B3"]
    assert machines.loc["B3", "state"] == "effect"
    assert "backlash at X" in machines.loc["B3", "why"]
    assert len(pd.read_csv(tmp_path / "out/findings.csv")) >= 6
    found = fleet(tmp_path / "list.csv", tmp_path / "out", command="diagnose", workers=1)
    assert [t.get_text() for t in draw_matrix(found).axes[0].texts] == ["✓"]


@pytest.mark.long
def test_a_cycle_that_cannot_be_read_stops_no_other(tmp_path: Path) -> None:
    mill_fleet(tmp_path, 3)
    done("fit", MILL, tmp_path / "data/m0_0.csv", "--out", tmp_path / "fit")
    write(tmp_path / "bad.csv", b"\xff\xfe\x00")
    surveys = ("bad.csv", "data/m1_0.csv")
    lines = [f"fit,{s},M00,2026-0{n + 1}-01" for n, s in enumerate(surveys)]
    text = "machine,survey,id,date\n" + "\n".join(lines) + "\n"
    result = fleet_of(tmp_path, text, "--command", "monitor")
    assert result.code == 1
    assert "1 of 2 surveys failed" in result.out
    assert list(pd.read_csv(tmp_path / "out/surveys.csv")["status"]) == ["failed", "done"]
    assert list(pd.read_csv(tmp_path / "out/failures.csv")["row"]) == [1]
    write(tmp_path / "bad.csv", (tmp_path / "data/m2_0.csv").read_bytes())  # corrected
    result = fleet_of(tmp_path, text, "--command", "monitor")
    assert result.code == 0
    assert list(pd.read_csv(tmp_path / "out/surveys.csv")["status"]) == ["done"] * 2


def test_iso_figures_of_a_fleet(tmp_path: Path) -> None:
    """Straightness of X along its travel: one machine bends ten times as much as the others do."""
    position = np.linspace(-300, 300, 13)
    lines = ["machine,survey,id"]
    for k in range(6):
        bow = (1.0 + 0.05 * k) * (0.03 if k == 4 else 0.003) * (1 - (position / 300) ** 2)
        rows = pd.DataFrame({"joint": "X", "X": position, "dy": bow, "dz": 0.5 * bow})
        write(tmp_path / f"m{k}.csv", rows.to_csv(index=False))
        lines.append(f"{MILL},m{k}.csv,M{k}")
    result = fleet_of(tmp_path, "\n".join(lines) + "\n", "--command", "iso", "--standard", "230-1")
    assert result.code == 0, result.out
    machines = pd.read_csv(tmp_path / "out/machines.csv").set_index("id")
    assert list(machines.index[machines["out"]]) == ["M4"]
    assert machines.loc["M4", "reasons"] > 1
    assert 30 < machines.loc["M4", "effect_um"] < 45  # the bow of 42 um beside the others' 4, not a sum
    done("iso", "230-1", MILL, tmp_path / "m2.csv", "--json", tmp_path / "m2.json")
    (standard,) = json.loads((tmp_path / "m2.json").read_text())["standards"]
    table = pd.read_csv(tmp_path / "out/parameters.csv")
    own = table[table["id"] == "M2"].set_index("parameter")["value"].to_dict()
    assert own == {f"230-1 {q['name']}": q["value"] for q in standard["quantities"]}
    assert not len(pd.read_csv(tmp_path / "out/common.csv"))  # a range is never about zero
