"""Machines of ten kinds with links of random length; none has the dimensions of one in the library.

`roles` say what the members are: ``beam`` travels along a beam held at both ends, ``ram`` telescopes out sideways,
``column`` travels up a column, ``dual`` has a drive at each foot, ``across`` travels over it.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from tests.proof.kinematics import MOTIONS, Chain, Element, terms

Rng = np.random.Generator
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def shape(name: str, *offset: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Element:
    return Element(name, "shape", (offset[0], offset[1], offset[2]), turn)


def slide(name: str, axis: tuple[float, float, float], low: float, high: float) -> Element:
    return Element(name, "prismatic", axis=axis, travel=(round(low, 3), round(high, 3)))


def turner(name: str, axis: tuple[float, float, float], low: float, high: float) -> Element:
    return Element(name, "rotary", axis=axis, travel=(np.radians(low), np.radians(high)), model=("harmonic", 1))


def minus(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    return (-axis[0] + 0.0, -axis[1] + 0.0, -axis[2] + 0.0)


def _r(rng: Rng, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 1)


def c_frame_mill(rng: Rng) -> Chain:
    """Table X on saddle Y below, ram Z above, all of 0.3 to 0.9 m."""
    x, y, z = _r(rng, 400, 900), _r(rng, 300, 600), _r(rng, 300, 600)
    tool = (0.0, 0.0, -_r(rng, 90, 160))
    return Chain(
        (
            slide("X", minus(X), -x / 2, x / 2), shape("S1", 0, 0, -_r(rng, 80, 150)),
            slide("Y", minus(Y), -y / 2, y / 2), shape("S2", 0, _r(rng, 300, 600), _r(rng, 500, 900)),
            slide("Z", Z, -z, 0), shape("S3", 0, -_r(rng, 300, 500), -_r(rng, 100, 250)),
        ),
        (tool, (_r(rng, 20, 60), _r(rng, -40, 40), tool[2] - _r(rng, 60, 140))),
        {"column": ("Z", "Y")},
    )  # fmt: skip


def fork_gantry(rng: Rng) -> Chain:
    """Portal of 4 to 8 m with a fork head C, A."""
    x, y, z = _r(rng, 4000, 8000), _r(rng, 2000, 4000), _r(rng, 800, 1500)
    tool = (0.0, 0.0, -_r(rng, 180, 320))
    return Chain(
        (
            slide("X", X, 0, x), shape("P1", 0, 0, _r(rng, 1500, 2600)),
            slide("Y", Y, 0, y), shape("P2", _r(rng, 150, 400), 0, 0),
            slide("Z", Z, -z, 0), shape("P3", 0, 0, -_r(rng, 300, 600)),
            turner("C", Z, -180, 180), shape("P4", 0, 0, -_r(rng, 100, 250)),
            turner("A", X, -95, 95), shape("P5", 0, 0, 0),
        ),
        (tool, (0.0, _r(rng, 20, 60), tool[2] - _r(rng, 80, 160))),
        {"beam": ("Y", "Z"), "dual": ("X", "Y")},
    )  # fmt: skip


def trunnion(rng: Rng) -> Chain:
    """Trunnion table C on A, tool moved by Y, X, Z of 0.4 to 0.6 m."""
    x, y, z = _r(rng, 400, 600), _r(rng, 400, 550), _r(rng, 350, 500)
    tool = (0.0, 0.0, -_r(rng, 80, 140))
    return Chain(
        (
            turner("C", minus(Z), 0, 360), shape("K1", 0, 0, -_r(rng, 30, 90)),
            turner("A", minus(X), -110, 30), shape("K2", 0, _r(rng, 30, 80), _r(rng, 50, 120)),
            slide("Y", Y, -y / 2, y / 2), shape("K3", 0, 0, _r(rng, 200, 350)),
            slide("X", X, -x / 2, x / 2), shape("K4", 0, -_r(rng, 80, 180), 0),
            slide("Z", Z, 0, z), shape("K5", 0, 0, _r(rng, 100, 180)),
        ),
        (tool, (_r(rng, 15, 40), _r(rng, -30, 30), tool[2] - _r(rng, 50, 90))),
        {"column": ("Z", "X")},
    )  # fmt: skip


def bridge(rng: Rng) -> Chain:
    """Bridge coordinate measuring machine; the bridge travels along X."""
    x, y, z = _r(rng, 700, 1600), _r(rng, 500, 1000), _r(rng, 400, 700)
    return Chain(
        (
            slide("X", X, 0, x), shape("L1", 0, 0, _r(rng, 500, 900)),
            slide("Y", Y, 0, y), shape("L2", _r(rng, 50, 120), 0, 0),
            slide("Z", Z, -z, 0), shape("L3", 0, 0, -_r(rng, 100, 200)),
        ),
        ((0.0, 0.0, -_r(rng, 60, 150)), (_r(rng, 30, 90), _r(rng, -80, 80), -_r(rng, 40, 90))),
        {"beam": ("Y", "Z"), "dual": ("X", "Y")},
    )  # fmt: skip


def horizontal(rng: Rng) -> Chain:
    """Horizontal machining centre: table B on Z, column X, spindle Y."""
    x, y, z = _r(rng, 800, 1500), _r(rng, 700, 1200), _r(rng, 700, 1200)
    tool = (0.0, 0.0, -_r(rng, 150, 260))
    return Chain(
        (
            turner("B", Y, 0, 360), shape("H1", 0, -_r(rng, 100, 300), 0),
            slide("Z", minus(Z), -z, 0), shape("H2", 0, _r(rng, 100, 300), _r(rng, 200, 500)),
            slide("X", X, -x / 2, x / 2), shape("H3", 0, _r(rng, 200, 400), 0),
            slide("Y", Y, 0, y), shape("H4", 0, 0, -_r(rng, 200, 400)),
        ),
        (tool, (_r(rng, 30, 60), _r(rng, -50, 50), tool[2] - _r(rng, 60, 120))),
        {"column": ("Y", "X")},
    )  # fmt: skip


def arm(rng: Rng) -> Chain:
    """Six-axis arm of 0.8 to 2 m with a spherical wrist that is a little out of one point."""
    a, b = _r(rng, 380, 900), _r(rng, 350, 850)
    return Chain(
        (
            turner("J1", Z, -170, 170), shape("A1", _r(rng, 40, 160), 0, _r(rng, 250, 450)),
            turner("J2", Y, -60, 80), shape("A2", 0, 0, a),
            turner("J3", Y, -70, 100), shape("A3", b * 0.4, 0, _r(rng, 30, 80)),
            turner("J4", X, -180, 180), shape("A4", b * 0.6, 0, 0),
            turner("J5", Y, -110, 110), shape("A5", _r(rng, 70, 120), 0, 0),
            turner("J6", X, -180, 180), shape("A6", _r(rng, 20, 60), 0, 0),
        ),
        ((_r(rng, 40, 90), 0.0, _r(rng, 60, 120)), (_r(rng, 80, 160), _r(rng, -110, -60), 0.0)),
        {"arm": ("J2", "J3")},
    )  # fmt: skip


def scara(rng: Rng) -> Chain:
    """Selective compliance arm: two parallel turns, a quill, a turn."""
    a, b, z = _r(rng, 250, 450), _r(rng, 200, 350), _r(rng, 150, 320)
    return Chain(
        (
            turner("R1", Z, -130, 130), shape("M1", a, 0, _r(rng, 0, 60)),
            turner("R2", Z, -145, 145), shape("M2", b, 0, -_r(rng, 20, 60)),
            slide("Q", Z, -z, 0), shape("M3", 0, 0, -_r(rng, 40, 90)),
            turner("R4", minus(Z), -180, 180), shape("M4", 0, 0, -_r(rng, 10, 40)),
        ),
        ((_r(rng, 30, 70), 0.0, -_r(rng, 20, 60)), (_r(rng, -20, 20), _r(rng, 40, 80), -_r(rng, 70, 120))),
        {},
    )  # fmt: skip


def moving_column(rng: Rng) -> Chain:
    """Column on X, headstock on Z up to 3 m, ram W out along Y."""
    x, z, w = _r(rng, 3000, 6000), _r(rng, 1500, 3000), _r(rng, 600, 1100)
    tool = (0.0, _r(rng, 200, 400), 0.0)
    return Chain(
        (
            slide("X", X, 0, x), shape("D1", 0, -_r(rng, 900, 1400), _r(rng, 400, 700)),
            slide("Z", Z, 0, z), shape("D2", _r(rng, 100, 300), _r(rng, 100, 250), 0),
            slide("W", Y, 0, w), shape("D3", 0, _r(rng, 250, 500), 0),
        ),
        (tool, (_r(rng, 60, 140), tool[1] + _r(rng, 60, 200), _r(rng, -80, 80))),
        {"ram": ("W",), "column": ("Z", "W")},
    )  # fmt: skip


def dual_gantry(rng: Rng) -> Chain:
    """Two motors along Y, crossbeam X, short Z; of an assembly line, 1 to 2 m."""
    y, x, z = _r(rng, 900, 2000), _r(rng, 700, 1400), _r(rng, 150, 350)
    return Chain(
        (
            slide("Y", Y, -y / 2, y / 2), shape("G1", 0, 0, _r(rng, 250, 450)),
            slide("X", X, -x / 2, x / 2), shape("G2", 0, _r(rng, 60, 150), 0),
            slide("Z", minus(Z), 0, z), shape("G3", 0, 0, -_r(rng, 60, 140)),
        ),
        ((_r(rng, 20, 50), 0.0, -_r(rng, 50, 120)), (_r(rng, -60, -20), _r(rng, 40, 90), -_r(rng, 40, 90))),
        {"beam": ("X", "Z"), "dual": ("Y", "X")},
    )  # fmt: skip


def rotary_mill(rng: Rng) -> Chain:
    """Four axes: a dividing head A on the table of a knee mill."""
    x, y, z = _r(rng, 500, 900), _r(rng, 350, 500), _r(rng, 350, 500)
    tool = (0.0, 0.0, -_r(rng, 90, 160))
    return Chain(
        (
            turner("A", minus(X), -180, 180), shape("V1", _r(rng, -300, -150), 0, -_r(rng, 120, 200)),
            slide("X", minus(X), -x / 2, x / 2), shape("V2", 0, 0, -_r(rng, 80, 140)),
            slide("Y", minus(Y), -y / 2, y / 2), shape("V3", 0, 0, -_r(rng, 200, 300)),
            slide("Z", minus(Z), -z, 0), shape("V4", 0, 0, _r(rng, 500, 700)),
        ),
        (tool, (_r(rng, 20, 50), _r(rng, -30, 30), tool[2] - _r(rng, 50, 100))),
        {"column": ("Z", "Y")},
    )  # fmt: skip


BUILDERS: dict[str, Callable[[Rng], Chain]] = {
    "c-frame-mill": c_frame_mill,
    "fork-gantry": fork_gantry,
    "trunnion": trunnion,
    "bridge-cmm": bridge,
    "horizontal": horizontal,
    "arm": arm,
    "scara": scara,
    "moving-column": moving_column,
    "dual-gantry": dual_gantry,
    "rotary-mill": rotary_mill,
}
NOISE = {  # standard deviation of a coordinate, mm
    "c-frame-mill": 0.0025, "fork-gantry": 0.009, "trunnion": 0.002, "bridge-cmm": 0.0011, "horizontal": 0.004,
    "arm": 0.02, "scara": 0.006, "moving-column": 0.006, "dual-gantry": 0.0018, "rotary-mill": 0.003,
}  # fmt: skip


def with_model(chain: Chain, order: int, first: bool = False, turns: int = 1) -> Chain:
    """The same machine, believed to have slides of that order (or of first order) and turns of so many harmonics."""
    elements = []
    for e in chain.elements:
        model = e.model
        if e.kind == "prismatic":
            model = ("first-order", 1) if first else ("polynomial", order)
        elif e.kind == "rotary":
            model = ("harmonic", turns) if e.length > 1.9 * pi else ("first-order", 1) if first else ("polynomial", 2)
        elements.append(Element(e.name, e.kind, e.offset, e.rotation, e.axis, e.travel, model))
    return Chain(tuple(elements), chain.tools, chain.roles)


def draw_geometry(chain: Chain, sigma: float, rng: Rng) -> dict[str, float]:
    """Error parameters of usual size: a few noise levels of each motion at the tool."""
    arms = [float(np.linalg.norm(e.offset)) for e in chain.elements] + [e.length for e in chain.prismatic]
    size = max(arms)
    out = {}
    for e in chain.elements:
        for name in terms(e, np.zeros(1)):
            motion = name.split(".")[1]
            scale = 4 * sigma if motion in MOTIONS[:3] else 4 * sigma / size
            if e.kind == "prismatic" and e.model[0] == "first-order":
                scale /= e.length if motion in MOTIONS[:3] else e.length / 2
            out[name] = float(rng.normal(0, scale))
    return out
