"""What a certificate shows beside its figures: contributions to the uncertainty, and the worst decision first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.surveys.record import limit_of
from identification import iso
from identification.conformity.decision import conformity
from identification.conformity.text import headline
from identification.iso_standards.base import Quantity

MILL = "vertical_three_axis"
RECORD = """errormodel: 1
files: [{path: x.csv}]
test:
  ambient: {machine_temperature: 21.1}
  uncertainty: {device: 0.001, misalignment: 0.5, temperature: 0.3, coefficient_bound: 2.0e-6, environment: 0.001}
"""


def test_contributions_of_annex_a_are_listed_and_make_up_the_uncertainty(tmp_path: Path) -> None:
    targets = np.linspace(-280.0, 280.0, 9)
    rows = [
        {"joint": "X", "X": x, "dx": 1e-5 * x + 1e-4 * n * side, "dir_X": side, "run": str(n)}
        for n in range(5)
        for side in (1, -1)
        for x in targets[::side]
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "x.csv", index=False)
    (tmp_path / "survey.yaml").write_text(RECORD)
    result = iso("230-2", MILL, tmp_path / "survey.yaml")
    sheet = next(s for s in result.evaluations[0].sheets if s.name == "uncertainty-X")
    shown = {row[0]: float(row[-1]) for row in sheet.rows}
    # by hand, in um: 0.3 R^2 / L; 0.6 times the range of temperature, and of the coefficient at 1.1 K
    expected = {
        "device": 1.0, "misalignment": 0.3 * 0.25 / 560 * 1e3, "temperature of the machine": 0.6 * 0.6 * 11.5e-3 * 560,
        "coefficient of expansion": 0.6 * 4e-3 * 1.1 * 560, "variation of the environment": 0.6,
    }  # fmt: skip
    assert shown == pytest.approx(expected, abs=0.005)
    of_m = next(q for q in result.evaluations[0].quantities if q.name == "X.M").expanded
    common = sum(v**2 for k, v in expected.items() if k != "variation of the environment")
    assert of_m == pytest.approx(1e-3 * np.sqrt(common + 0.6**2 / 5), rel=1e-6)


def test_without_a_device_there_is_no_budget(tmp_path: Path) -> None:
    rows = [{"joint": "X", "X": x, "dx": 1e-5 * x, "dir_X": s} for s in (1, -1) for x in (-100.0, 0.0, 100.0)]
    result = iso("230-2", MILL, pd.DataFrame(rows))
    assert [s.name for s in result.evaluations[0].sheets] == ["targets-X"]


def test_what_is_furthest_beyond_its_limit_comes_first() -> None:
    sizes = {"A": 0.011, "B": 0.030, "C": 0.0099, "D": 0.002}
    found = conformity(
        [Quantity(n, n, n, v, "mm", 1e-3, "") for n, v in sizes.items()], dict.fromkeys(sizes, limit_of("10 um")),
        "guard-band",
    )  # fmt: skip
    assert [j.quantity.symbol for j in found.by_severity] == ["B", "A", "C", "D"]
    assert headline(found).startswith("Fails: B.B 30")
