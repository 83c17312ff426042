"""Files of printers in the firmwares' own code, whose sources are taken from a path: they are not in the project.

``ERRORMODEL_KLIPPER`` and ``ERRORMODEL_MARLIN`` name checkouts of Klipper3d/klipper and MarlinFirmware/Marlin. Modules
of Klipper are executed; of Marlin's planner the one function of the skew is compiled.
"""

from __future__ import annotations

import configparser
import importlib
import inspect
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.helpers.firmware import POSES, function, places, source, written


class Section:
    """A section of a configuration, as Klipper hands it to its modules."""

    error = ValueError

    def __init__(self, parser: configparser.ConfigParser, name: str) -> None:
        self.parser, self.name = parser, name

    def get_printer(self) -> Section:
        return self

    def get_name(self) -> str:
        return self.name

    def get_prefix_sections(self, prefix: str) -> list[Section]:
        return [Section(self.parser, n) for n in self.parser.sections() if n.startswith(prefix)]

    def lookup_object(self, name: str, *_: object) -> Section:
        return self

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: None

    def get(self, key: str, *default: Any) -> Any:
        return self.parser.get(self.name, key, fallback=default[0] if default else None)

    def getfloat(self, key: str, *default: Any, **_: Any) -> float:
        return float(self.get(key, *default))

    def getint(self, key: str, *default: Any, **_: Any) -> int:
        return int(self.get(key, *default))

    def getlists(self, key: str, *_: Any, seps: tuple[str, ...] = (",",), parser: Any = str, **__: Any) -> Any:
        rows = [r for r in str(self.get(key)).strip().split(seps[-1]) if r.strip()]
        return tuple(tuple(parser(v.strip()) for v in row.split(seps[0])) for row in rows)


class Command:
    """A command with its parameters."""

    error = ValueError

    def __init__(self, **words: str) -> None:
        self.words = words

    def get(self, key: str, default: Any = None) -> Any:
        return self.words.get(key, default)

    def respond_info(self, text: str) -> None:
        raise AssertionError(text)


def klipper_module(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    folder = source("ERRORMODEL_KLIPPER", f"klippy/extras/{name}.py") / "klippy"
    monkeypatch.syspath_prepend(str(folder))
    for other in ("probe", "manual_probe"):  # what probes the bed plays no part here
        monkeypatch.setitem(sys.modules, f"extras.{other}", ModuleType(f"extras.{other}"))
    for loaded in [m for m in sys.modules if m == "extras" or m == f"extras.{name}"]:
        monkeypatch.delitem(sys.modules, loaded)
    return importlib.import_module(f"extras.{name}")


def configuration(text: str) -> configparser.ConfigParser:
    """As klippy/configfile.py reads it."""
    parser = configparser.RawConfigParser(strict=False, inline_comment_prefixes=(";", "#"))
    parser.read_string(text)
    return parser


def test_klipper_loads_the_skew_and_moves_as_emulated(monkeypatch: pytest.MonkeyPatch) -> None:
    module = klipper_module("skew_correction", monkeypatch)
    controller, setup, tables, files = written("klipper")
    parser = configuration("[skew_correction]\n" + files["errormodel.cfg"])
    skew = module.PrinterSkew(Section(parser, "skew_correction"))
    skew.cmd_SKEW_PROFILE(Command(LOAD="errormodel"))
    q = places(setup)
    sent = np.array([skew.calc_skew([*row, 0.0])[:3] for row in q])
    plain = tuple(t for t in tables if not t.term.inputs)
    np.testing.assert_allclose(sent - q, controller.emulate(plain, setup, q), atol=controller.quantum(setup))
    assert np.abs(sent - q).max() > 0.005


def test_klipper_loads_the_mesh_and_moves_as_emulated(monkeypatch: pytest.MonkeyPatch) -> None:
    module = klipper_module("bed_mesh", monkeypatch)
    controller, setup, tables, files = written("klipper")
    section = Section(configuration(files["errormodel.cfg"]), "bed_mesh errormodel")
    kinds = {"x_count": int, "y_count": int, "mesh_x_pps": int, "mesh_y_pps": int, "algo": str}
    keys = [*kinds, "min_x", "max_x", "min_y", "max_y", "tension"]
    named = ("errormodel",) if "name" in inspect.signature(module.ZMesh).parameters else ()  # since 2024
    mesh = module.ZMesh({k: kinds.get(k, float)(section.get(k)) for k in keys}, *named)
    mesh.build_mesh([list(row) for row in section.getlists("points", seps=(",", "\n"), parser=float)])
    assert section.getint("version") == module.PROFILE_VERSION
    heights = tuple(t for t in tables if t.term.inputs)
    q = places(setup)
    wanted = controller.emulate(heights, setup, q)[:, 2]
    np.testing.assert_allclose([mesh.calc_z(x, y) for x, y, _ in q], wanted, atol=controller.quantum(setup))
    assert np.ptp(wanted) > 0.005


CALLER = """
#include <cstdio>
#include <cstdlib>
typedef const float const_float_t;
#define FORCE_INLINE inline
#define WITHIN(N,L,H) ((N) >= (L) && (N) <= (H))
#define COORDINATE_OKAY(N,L,H) WITHIN(N,L,H)
struct { float xy, xz, yz; } skew_factor;
float X_MIN_POS, X_MAX_POS, Y_MIN_POS, Y_MAX_POS;
%s
int main(int n, char **a) {
  skew_factor = { strtof(a[1], 0), strtof(a[2], 0), strtof(a[3], 0) };
  X_MIN_POS = atof(a[4]); X_MAX_POS = atof(a[5]); Y_MIN_POS = atof(a[6]); Y_MAX_POS = atof(a[7]);
  double x, y, z;
  while (scanf("%%lf %%lf %%lf", &x, &y, &z) == 3) {
    float cx = x, cy = y;
    skew(cx, cy, (float)z);
    printf("%%.7f %%.7f\\n", cx, cy);
  }
}
"""


def test_marlin_moves_as_emulated(tmp_path: Path) -> None:
    """In the volume and at its edges, where the firmware corrects nothing."""
    header = source("ERRORMODEL_MARLIN", "Marlin/src/module/planner.h") / "Marlin/src/module/planner.h"
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler (g++)")
    controller, setup, tables, files = written("marlin")
    own = function(header.read_text(encoding="utf-8"), "FORCE_INLINE static void skew(float &cx")
    (tmp_path / "skew.cpp").write_text(CALLER % own)
    subprocess.run([compiler, "-O1", "-o", "skew", "skew.cpp"], cwd=tmp_path, check=True)
    (text,) = files.values()
    words = re.search(r"^M852 I(\S+) J(\S+) K(\S+)$", text, re.MULTILINE)
    assert words is not None
    limits = [str(v) for n in "XY" for v in setup.axis(n).travel]
    edge = places(setup)
    edge[:, 0] = np.random.default_rng(5).choice([-199.9, -199.5, -198.0, 399.99, 400.0], POSES)
    q = np.vstack([places(setup), edge])
    done = subprocess.run(
        ["./skew", *words.groups(), *limits], cwd=tmp_path, check=True, text=True, capture_output=True,
        input="\n".join(" ".join(f"{v:.7f}" for v in row) for row in q),
    )  # fmt: skip
    sent = np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()])
    wanted = controller.emulate(tables, setup, q)[:, :2]
    assert np.abs(wanted).max() > 0.005
    assert (wanted[POSES:] == 0).all(axis=1).sum() > POSES / 4
    np.testing.assert_allclose(sent - q[:, :2], wanted, atol=5e-5)  # floats of 400 mm have steps of 31 nm
