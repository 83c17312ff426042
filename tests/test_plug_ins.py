"""What a user's own package brings by an entry point works like the project's own: one file an effect, and no other."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

EFFECT = '''
"""A step of the position where a coupling slips over a tooth."""

from errormodel.effects.base import EffectTerm, JointEffect, along
from errormodel.machine import joint_of


class Slip(JointEffect):
    """``size`` along the joint's axis beyond the position ``at`` (mm)."""

    effect = "coupling-slip"
    family = "geometric"
    source = "a test"
    separate = "measure across the tooth in steps of a millimetre"
    example = {"joint": "X", "at": 100.0}
    at: float

    @property
    def drivers(self):
        return (self.joint,)

    def terms(self, channel, machine):
        joint = joint_of(machine, self.joint)
        return [EffectTerm(self.joint, "", "mm", along(joint, channel(self.joint) > self.at), 0.02)]

    @classmethod
    def proposals(cls, scene):
        for joint in scene.moving:
            if joint.type == "prismatic":
                low, high = joint.travel
                for share in (0.3, 0.4, 0.5, 0.6, 0.7):
                    yield cls(joint=joint.name, at=low + share * (high - low))
'''
INSTRUMENT = '''
"""A probe that knows z better than x and y."""

from typing import Literal

import numpy as np

from errormodel.instruments.base import Instrument, Positive, Source


class Probe(Instrument):
    """Standard uncertainties across and along z, mm."""

    type: Literal["flat-probe"] = "flat-probe"
    across: Positive
    along: Positive

    def sources(self, points):
        rows = np.ones((len(points), 1, 1))
        return [
            Source("across", self.across, "mm", rows * np.diag([1.0, 1.0, 0.0]) * self.across**2),
            Source("along", self.along, "mm", rows * np.diag([0.0, 0.0, 1.0]) * self.along**2),
        ]
'''
FORMAT = '''
"""Tables with a bar between the cells."""

from errormodel.formats.csv_file import open_table as opened

SUFFIXES = (".bar",)


def open_table(path, name):
    table = path.with_suffix(".csv")
    table.write_text(path.read_text().replace("|", ","))
    return opened(table, name)
'''
GROUPS = {"effects": EFFECT, "instruments": INSTRUMENT, "formats": FORMAT}


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an installed package of the user's."""
    folder = tmp_path_factory.mktemp("site")
    info = folder / "shop_floor-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: shop-floor\nVersion: 1.0\n")
    lines = []
    for group, text in GROUPS.items():
        (folder / f"shop_{group}.py").write_text(text)
        lines.append(f"[errormodel.{group}]\nmine = shop_{group}\n")
    (info / "entry_points.txt").write_text("\n".join(lines))
    return folder


def run(elsewhere: Path, *words: object) -> str:
    program = "from identification.command_line.main import entry; entry()"
    paths = os.pathsep.join([str(elsewhere), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, words)],
        cwd=elsewhere, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_package_of_the_users_brings_an_effect(elsewhere: Path) -> None:
    """Simulated, found by the diagnosis under its name, fitted, predicted, in the report and in the documentation."""
    (elsewhere / "slip.yaml").write_text(
        (ROOT / "machines/vertical_three_axis.yaml").read_text()
        + "\neffects: [{effect: coupling-slip, joint: X, at: 76}]\n"
    )
    travel = "vertical_three_axis"
    (elsewhere / "truth.yaml").write_text("parameters: {X.dx.coupling-slip: 0.02}\n")
    words = ["--parameters", "truth.yaml", "--noise", 0.001, "--out", "s.csv"]
    run(elsewhere, "simulate", "slip.yaml", 200, *words)
    said = run(elsewhere, "diagnose", travel, "s.csv", "--out", "found")
    (finding,) = json.loads((elsewhere / "found/diagnosis.json").read_text())["findings"]
    assert (finding["effect"], finding["where"]) == ("coupling-slip", "X"), said
    assert "coupling" in (elsewhere / "found/report.html").read_text()
    run(elsewhere, "fit", "slip.yaml", "s.csv", "--out", "fitted")
    values = {p["id"]: p for p in json.loads((elsewhere / "fitted/fit.json").read_text())["parameters"]}
    slip = values["X.dx.coupling-slip"]
    assert abs(slip["value"] - 0.02) < 4 * slip["std"]
    run(elsewhere, "predict", "found", "s.csv", "--out", "p.csv")
    program = "import sys; sys.path.insert(0, 'docs'); import generate; print(*generate.effects(), sep='\\n')"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(elsewhere), str(ROOT)])}
    page = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True, env=environment
    )
    assert "### coupling-slip" in page.stdout


def test_a_package_of_the_users_brings_an_instrument_and_a_format(elsewhere: Path) -> None:
    run(elsewhere, "simulate", "vertical_three_axis", 60, "--noise", 0.001, "--out", "plain.csv")
    (elsewhere / "data.bar").write_text((elsewhere / "plain.csv").read_text().replace(",", "|"))
    instrument = "{type: flat-probe, across: 0.001, along: 0.0005}"
    (elsewhere / "survey.yaml").write_text(f"errormodel: 1\nfiles: [{{path: data.bar}}]\ninstrument: {instrument}\n")
    run(elsewhere, "fit", "vertical_three_axis", "survey.yaml", "--out", "probed")
    assert json.loads((elsewhere / "probed/fit.json").read_text())["sigma_from"] == "declared"
