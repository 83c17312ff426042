"""Single surveys of a fleet: one in another unit, a copy, and a machine that is not pooled with its type."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from identification.fleets.collecting import Collected
from identification.fleets.comparison import Type, compared, quantity
from identification.fleets.listing import Listing
from identification.fleets.partial_pooling import Surveys
from identification.fleets.places import Base
from identification.monitoring.quantities import Watched
from identification.results.fleet_result import FleetResult
from tests.helpers.commands import MILL, run, write
from tests.helpers.fleets import mill_fleet

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
def test_one_survey_in_another_unit_is_named_and_spoils_no_other(tmp_path: Path) -> None:
    """Six mills; the second survey of one is in inch, and the first of another is listed twice, as a copy."""
    listing = mill_fleet(tmp_path, 6)
    model = (ROOT / f"machines/{MILL}.yaml").read_text()
    write(tmp_path / "mill.yaml", re.sub(r"travel: \[120(\.0)?,", "travel: [0,", model))  # or inches would be off it
    rows = listing.read_text().replace(f"{MILL},", "mill.yaml,").splitlines()
    bad = pd.read_csv(tmp_path / "data/m1_0.csv").rename(columns=str)
    lengths = [c for c in bad if c in ("X", "Y", "Z", "mx", "my", "mz")]
    bad[lengths] = bad[lengths] / 25.4
    write(tmp_path / "data/inch.csv", bad.to_csv(index=False))
    write(tmp_path / "data/copy.csv", (tmp_path / "data/m0_0.csv").read_bytes())
    rows += [f"mill.yaml,data/{f}.csv,{m},mill,2023-05-01,A" for f, m in (("inch", "M01"), ("copy", "M00"))]
    write(listing, "\n".join(rows) + "\n")
    result = run("fleet", listing, "--out", tmp_path / "out", "--workers", 1)
    assert result.code == 1
    assert "row 8, M00: data/copy.csv: byte for byte data/m0_0.csv, the survey of row 1" in result.out
    notes = result.out.partition("\nnotes\n")[2]
    assert re.search(r"fill their travels if they are in inch.*M01 \(data/inch.csv\)", notes)
    apart = result.out.partition("surveys apart from their machine and its type\n")[2]
    assert apart.startswith("  row 7, M01: data/inch.csv, ")
    assert "M01" in result.out.partition("visit first")[2].partition("notes")[0]
    standing, own = (pd.read_csv(tmp_path / f"out/{name}.csv") for name in ("standing", "parameters"))
    both = standing[~standing["id"].isin(["M00", "M01"])].merge(own, on=["id", "parameter"])
    assert len(both) > 60
    assert (both["std_x"] < 5 * both["std_y"]).all()  # that of the survey, and what all machines scatter at most
    page = (tmp_path / "out/fleet.html").read_text()
    assert "data/inch.csv" in page
    assert 'href="parts/M02/' in page
    assert 'title="M02: normal. hall A' in page
    assert "of the type" in page


def test_what_drifts_is_not_pooled_with_its_type(tmp_path: Path) -> None:
    """By estimates: five machines that keep still, and one that changes."""
    rng = np.random.default_rng(1)
    machine, date = np.repeat(np.arange(6), 3), np.tile(np.arange(3.0), 6)
    y = rng.normal(0, 1, 18) + 50 * date * (machine == 5)
    q = quantity(Watched("q", "q", "", "mm", {"q": 1.0}), np.arange(6), Surveys(y, np.ones(18), machine, date), 1.0)
    names = tuple(f"M{k}" for k in range(6))
    whole = Collected("fit", Listing("list.csv", Base("", ""), (), ()), ())
    table = FleetResult(whole, compared([Type("mill", names, (q,), ())], 0.01)).standing.set_index("id")
    assert table["drifts"].tolist() == [False] * 5 + [True]
    assert table.loc["M5", "trend_pooled"] == table.loc["M5", "trend"] == pytest.approx(50, abs=3)
    assert table.loc["M5", "trend_pooled_std"] == table.loc["M5", "trend_std"]
    assert (table["trend_pooled_std"] > 0).all()
