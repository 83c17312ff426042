"""Every reader of a file, with a sound file of its kind to start mutations from."""

from __future__ import annotations

import shutil
import struct
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from errormodel.chain import Chain
from errormodel.exceptions import ErrorModelError
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from errormodel.truth import read_truth
from identification.bayes.settings import read_priors
from identification.compensation.rows import read_rows
from identification.planning.setup import read_setup
from identification.registration.form import read_profiler
from identification.registration.readers import read_cloud
from identification.results import manifest
from identification.results.stored_fit import read_files

HERE = Path(__file__).resolve().parents[1]
OLD = HERE / "contract/version_1/fit"  # a small result
MOST_S = 5.0  # s of the processor that a file of a few kB may take
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    b"end_header\n1 2 3\n4 5 6\n"
)
PCD = (
    b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n" + struct.pack("<6f", *range(6))
)
PLY_BINARY = PLY.split(b"1 2 3")[0].replace(b"ascii", b"binary_little_endian") + struct.pack("<6f", *range(6))


@dataclass(frozen=True)
class Reader:
    """A reader, the name that its file has, and a sound content."""

    file: str
    sound: bytes
    read: Callable[[Path], object]


@cache
def readers() -> dict[str, Reader]:
    """Readers by name."""
    machine = read_machine(OLD)
    rows = (OLD.parent / "expected.csv").read_bytes().replace(b"ex,ey,ez,ux,uy,uz", b"time,T_a,w_b,w_c,w_d,w_e")

    def whole(folder: Path) -> object:
        return read_files(folder.parent)

    known = (OLD / "fit.json").read_bytes()
    made = [
        ("machine", Reader("machine.yaml", (OLD / "machine.yaml").read_bytes(), read_machine)),
        ("survey", Reader("s.csv", rows, lambda p: read_survey(p, machine))),
        ("commands", Reader("s.txt", rows.replace(b",", b";"), lambda p: read_survey(p, machine, measured=False))),
        ("form", Reader("s.yaml", b"errormodel: 1\nfiles:\n  - {path: points.csv, role: fit}\nframe: per-run\n"
                        b"units: {length: mm, X: m}\ninstrument: {type: cmm, sigma: [1e-3, 1e-6]}\n"
                        b"budget: [{name: a, std: 0.1, acts: X}]\n",
                        lambda p: read_survey(p, machine, measured=False))),
        ("truth", Reader("t.yaml", b"parameters: {X.dx.1: 0.02}\nframe: {translation: [1, 2, 3], rotation: [0, 0, 9]}",
                         lambda p: read_truth(p, Chain(machine)))),
        ("priors", Reader("p.yaml", b"errormodel: 1\npriors:\n  X.dx.1: {low: -1, high: 1}\n", read_priors)),
        ("setup", Reader("u.yaml", b"errormodel: 1\ntravels: {X: [0, 300]}\ntools: [[0, 0, -50]]\n",
                         lambda p: read_setup(p, machine))),
        ("profiler", Reader("r.yaml", b"joint: Y\npositions: [1, 2]\nlever: [0, 0, 0]\n"
                            b"mount: {translation: [0, 0, 0], rotation: [0, 0, 0]}\n", read_profiler)),
        ("cloud", Reader("c.csv", b"x,y,z\n1,2,3\n4,5,6\n", lambda p: read_cloud(p, p.name, None))),
        ("ply", Reader("c.ply", PLY, lambda p: read_cloud(p, p.name, None))),
        ("binary ply", Reader("c.ply", PLY_BINARY, lambda p: read_cloud(p, p.name, None))),
        ("pcd", Reader("c.pcd", PCD, lambda p: read_cloud(p, p.name, None))),
        ("compressed pcd", Reader("c.pcd", PCD.replace(b"DATA binary", b"DATA binary_compressed"),
                                  lambda p: read_cloud(p, p.name, None))),
        ("fit", Reader("fit.json", known, whole)),
        ("covariance", Reader("covariance.csv", (OLD / "covariance.csv").read_bytes(), whole)),
        ("residuals", Reader("residuals.csv", (OLD / "residuals.csv").read_bytes(),
                             lambda p: read_rows(p.parent, machine))),
        ("manifest", Reader("manifest.json", (OLD / "manifest.json").read_bytes(),
                            lambda p: manifest.check_whole(p.parent))),
    ]  # fmt: skip
    return dict(made)


def tried(name: str, content: bytes) -> bool:
    """Read a content; whether it was taken. Anything but the project's own refusal is raised, slowness too."""
    reader = readers()[name]
    with tempfile.TemporaryDirectory() as space:
        folder = Path(space) / "fit"
        shutil.copytree(OLD, folder)
        shutil.copy(OLD.parent / "points.csv", folder)
        path = folder / reader.file
        path.write_bytes(content)
        begun = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                reader.read(path)
        except ErrorModelError:
            return False
        finally:
            took = time.process_time() - begun
            assert took < MOST_S, f"{took:.1f} s for {len(content)} bytes"
    return True
