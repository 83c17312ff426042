"""A recorded axis with results that were published for it, not all of which are those of ISO 230-2.

R: the standard takes the largest ``R_i``, which contains the reversal; the program behind the report starts from the
forward R and compares it with itself. E: the standard takes the range of all means; the program subtracts the larger of
the two minima, because a comparison is turned round.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.commands import done

MACHINE = """errormodel: 1
name: One axis
chain:
  - {joint: X, type: prismatic, axis: x, travel: [-30, 30]}
tool: [0, 0, 0]
errors: {shapes: none, joints: {X: first-order}}
"""
SURVEY = """errormodel: 1
files: [{path: iso230_2_x.csv}]
frame: fixed
columns: {X: target_mm, mx: position_mm, run: cycle}
"""
NAMES = {
    "B": "B", "B_mean": "B mean", "R_forward": "R↑", "R_backward": "R↓", "E_forward": "E↑", "E_backward": "E↓",
    "M": "M", "A": "A", "A_forward": "A↑", "A_backward": "A↓",
}  # fmt: skip
ROUNDED = 1.5e-5  # mm: readings and results have five decimals each


@pytest.fixture
def recorded(real_data: Path, tmp_path: Path) -> tuple[Path, dict[str, float]]:
    files = real_data / "files"
    if not (files / "iso230_2_x.csv").is_file():
        pytest.skip("the recording of ISO 230-2 is not there (ERRORMODEL_DATA)")
    (tmp_path / "axis.yaml").write_text(MACHINE)
    (tmp_path / "survey.yaml").write_text(SURVEY)
    (tmp_path / "iso230_2_x.csv").symlink_to(files / "iso230_2_x.csv")
    return tmp_path, json.loads((files / "iso230_2_x_published.json").read_text())


def test_the_published_figures_but_for_r_and_e(recorded: tuple[Path, dict[str, float]]) -> None:
    folder, published = recorded
    out = folder / "figures.json"
    done("iso", "230-2", folder / "axis.yaml", folder / "survey.yaml", "--json", out)
    (standard,) = json.loads(out.read_text())["standards"]
    figures = {q["symbol"]: q["value"] for q in standard["quantities"]}
    assert set(published) == {*NAMES, "R", "E"}
    for theirs, ours in NAMES.items():
        assert figures[ours] == pytest.approx(published[theirs], abs=ROUNDED), theirs
    data = {name: np.array(value) for name, value in standard["data"]["X"].items() if isinstance(value, list)}
    up, down = data["mean_up"], data["mean_down"]
    together = 2 * data["s_up"] + 2 * data["s_down"] + np.abs(up - down)
    assert figures["R"] == pytest.approx(together.max())
    assert figures["R"] > 1.9 * published["R"]
    assert published["R"] == pytest.approx(figures["R↑"], abs=ROUNDED)
    assert figures["E"] == pytest.approx(max(up.max(), down.max()) - min(up.min(), down.min()))
    assert figures["E"] > 1.3 * published["E"]
    assert published["E"] == pytest.approx(max(up.max(), down.max()) - max(up.min(), down.min()), abs=ROUNDED)
