"""Height maps and skew of RepRapFirmware in its own code: its loader, its interpolation, its transforms.

``ERRORMODEL_REPRAPFIRMWARE`` names a checkout of Duet3D/RepRapFirmware, version 3.4 or later; without one the tests are
skipped. Its Grid.cpp is compiled as it is, of Move3.cpp (Move.cpp before 3.6) the functions that change a position;
``tests/helpers/reprapfirmware.h`` stands for the rest of the firmware. M556 itself is read by the test: the order of
its letters is that of the firmware's SetAxisCompensation (X: XY, Y: YZ, Z: XZ).
"""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from errormodel.controllers.duet import M556
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from tests.helpers.chains import Array
from tests.helpers.firmware import POSES, function, places, source, written
from tests.helpers.setups import plain_setup

HELPERS = Path(__file__).parents[1] / "helpers"
HEADERS = (
    "RepRapFirmware.h", "ObjectModel/ObjectModel.h", "Platform/Platform.h", "Platform/RepRap.h", "GCodes/GCodes.h",
    "Storage/FileStore.h", "Math/Deviation.h",
)  # fmt: skip
CHANGES = (
    "AxisAndBedTransform", "AxisTransform", "ForEachHeightCorrection", "ComputeHeightCorrection", "BedTransform",
    "SetTaperHeight",
)  # fmt: skip
FLOAT_MM = 1e-4  # three additions of floats of 400 mm, which have steps of 31 nm
CALLER = """
#include "{grid}"
class Move {{
public:
    bool compensateXY = true, usingMesh = false, useTaper = false;
    float zShift = 0.0, taperHeight = 0.0, recipTaperHeight = 0.0;
    {tangents}
    HeightMap heightMap;
    const GridDefinition& GetGrid() const noexcept {{ return heightMap.GetGrid(); }}
    {declared}
}};
{own}
int main(int n, char **a) {{
    static Move move;
    float *tangents[] = {{ {places} }};
    for (int k = 0; k < 3; k++) *tangents[k] = strtof(a[2 + k], 0);
    move.SetTaperHeight(strtof(a[5], 0));
    char said[200] = "";
    StringRef reply(said, sizeof(said));
    FileStore file(fopen(a[1], "r"));
    if (move.heightMap.LoadFromFile(&file, "heightmap.csv", reply)) {{
        puts(said);
        return 1;
    }}
    move.usingMesh = move.heightMap.UseHeightMap(true);
    float q[3];
    while (scanf("%f %f %f", q, q + 1, q + 2) == 3) {{
        move.AxisAndBedTransform(q, nullptr, true);
        printf("%.7f %.7f %.7f\\n", q[0], q[1], q[2]);
    }}
}}
"""


@dataclass(frozen=True)
class Firmware:
    """The compiled program: loads a height map, and moves points."""

    program: Path

    def sent(self, folder: Path, files: dict[str, str], q: Array, taper: float = 0.0) -> Array:
        """Positions (n, 3) after the firmware's transforms, mm."""
        skew = M556.search(files["config.g"])
        assert skew is not None
        (folder / "heightmap.csv").write_text(files["heightmap.csv"])
        tangents = [str(float(v) / 1000) for v in skew.groups()]
        done = subprocess.run(
            [self.program, folder / "heightmap.csv", *tangents, str(taper)], check=False, text=True,
            capture_output=True, input="\n".join(" ".join(f"{v:.7f}" for v in row) for row in q),
        )  # fmt: skip
        assert done.returncode == 0, done.stdout
        return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Firmware:
    checkout = source("ERRORMODEL_REPRAPFIRMWARE", "src/Movement/BedProbing/Grid.cpp") / "src/Movement"
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler (g++)")
    folder = tmp_path_factory.mktemp("firmware")
    for name in HEADERS:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text('#include "reprapfirmware.h"\n')
    place = next(checkout / n for n in ("Move3.cpp", "Move.cpp") if (checkout / n).is_file())
    text = place.read_text(encoding="utf-8")
    found = {n: re.search(rf"^\w+ Move::{n}\(", text, re.MULTILINE) for n in CHANGES}
    own = [function(text, m[0]) for m in found.values() if m]
    heads = [re.sub(r"\bMove::", "", code.partition("{")[0]).strip() + ";" for code in own]
    order = ("tanXY", "tanYZ", "tanXZ")
    by_call = "tanXY()" in text
    tangents = "float tangents[3];" + "".join(
        f" float {n}() const noexcept {{ return tangents[{k}]; }}" for k, n in enumerate(order)
    )
    program = CALLER.format(
        grid=checkout / "BedProbing/Grid.cpp",
        tangents=tangents if by_call else f"float {', '.join(order)};",
        places=", ".join(f"&move.tangents[{k}]" if by_call else f"&move.{n}" for k, n in enumerate(order)),
        declared="\n    ".join(heads), own="\n".join(own),
    )  # fmt: skip
    (folder / "main.cpp").write_text(program)
    # headers of the firmware's own tree come after those that stand for it
    command = [compiler, "-std=gnu++17", "-O1", f"-I{folder}", f"-I{HELPERS}", "-o", "program", "main.cpp"]
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]
    return Firmware(folder / "program")


def both(setup: Setup | None = None, size: float = 0.03) -> tuple[Array, Tables, dict[str, str], Array]:
    """Places inside, at the edges and beyond the map; tables as read back, files, and what is emulated there."""
    controller, setup, _, files = written("duet", size, setup)
    tables = controller.read(files, setup)
    low, high = np.array([a.travel for a in setup.axes]).T
    beyond = np.random.default_rng(6).choice([-40.0, -0.01, 0.0, 0.01, 40.0], (POSES, 3))
    edge = np.where(np.random.default_rng(7).random((POSES, 3)) < 0.5, low, high) + beyond
    q = np.vstack([places(setup), edge]).round(4)
    return q, tables, files, controller.emulate(tables, setup, q)


@pytest.mark.parametrize("size", [0.03, 3.0])
def test_the_firmware_loads_the_height_map_and_moves_as_emulated(
    size: float, firmware: Firmware, tmp_path: Path
) -> None:
    """With a large skew as well, after which the map is looked up elsewhere."""
    q, _, files, wanted = both(size=size)
    sent = firmware.sent(tmp_path, files, q) - q
    assert np.abs(wanted).max(axis=0).min() > 0.005  # of every axis
    np.testing.assert_allclose(sent, wanted, atol=FLOAT_MM)


def test_a_row_of_the_most_points_is_read_whole(firmware: Firmware, tmp_path: Path) -> None:
    q, tables, files, wanted = both(plain_setup(points=21))
    assert max(t.term.shape for t in tables if t.term.inputs) == (21, 21)
    np.testing.assert_allclose(firmware.sent(tmp_path, files, q) - q, wanted, atol=FLOAT_MM)


def test_a_taper_takes_the_map_away_with_height(firmware: Firmware, tmp_path: Path) -> None:
    """Why the checklist asks for M376 H0: what the firmware then does is no longer what the tables say."""
    _, _, files, _ = both()
    q = np.array([[10.0, 20.0, 1.0], [10.0, 20.0, 9.0], [10.0, 20.0, 11.0]])
    flat, faded = (firmware.sent(tmp_path, files, q, taper)[:, 2] - q[:, 2] for taper in (0.0, 10.0))
    np.testing.assert_allclose(faded, flat * np.clip(1 - q[:, 2] / 10, 0, 1), atol=FLOAT_MM)
    assert abs(flat[0]) > 0.002
