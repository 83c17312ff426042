"""Published robots, and their forward kinematics by matrices that are written out here: no code of the product."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from errormodel.arrays import Array, as_rows
from errormodel.chain import Chain
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_formats.base import Part, described, nominal
from errormodel.raw_formats.base import RawFile

SIX = (0.0,) * 6


@dataclass(frozen=True)
class Table:
    """Denavit-Hartenberg parameters, mm and degrees; `slides` are the joints whose d is the position (from 0)."""

    source: str
    a: Sequence[float]
    alpha: Sequence[float]
    d: Sequence[float]
    theta: Sequence[float]
    modified: bool = False
    slides: tuple[int, ...] = ()

    def csv(self, travel: str = "") -> str:
        rows = []
        for k, (a, alpha, d, theta) in enumerate(zip(self.a, self.alpha, self.d, self.theta, strict=True)):
            kind = "prismatic,300,900" if k in self.slides else "rotary,-170,170"
            word, low, high = kind.split(",")
            rows.append(f"J{k + 1},{word},{a!r},{alpha!r},{d!r},{theta!r},{low},{high}\n")
        return "joint,type,a,alpha,d,theta,low,high\n" + "".join(rows)

    @property
    def form(self) -> str:
        return "dh-modified" if self.modified else "dh"


ROBOTS = {
    "UR10": Table(
        "Universal Robots: DH parameters for calculations of kinematics and dynamics",
        (0, -612, -572.3, 0, 0, 0), (90, 0, 0, 90, -90, 0), (127.3, 0, 0, 163.941, 115.7, 92.2), SIX,
    ),
    "UR5e": Table(
        "the same", (0, -425, -392.2, 0, 0, 0), (90, 0, 0, 90, -90, 0), (162.5, 0, 0, 133.3, 99.7, 99.6), SIX
    ),
    "Puma 560": Table(
        "Corke and Armstrong-Helouvry, ICRA 1994",
        (0, 431.8, 20.3, 0, 0, 0), (90, 0, -90, 90, -90, 0), (0, 0, 150.05, 431.8, 0, 0), SIX,
    ),
    "Puma 560 of Craig": Table(
        "Craig, Introduction to Robotics, figure 3.21, with the lengths of Corke and Armstrong-Helouvry",
        (0, 0, 431.8, 20.3, 0, 0), (0, -90, 0, -90, 90, -90), (0, 0, 150.05, 431.8, 0, 0), SIX, modified=True,
    ),
    "KUKA LBR iiwa 7": Table(
        "KUKA: data sheet of the LBR iiwa 7 R800 (340, 400, 400, 126 mm between its axes)",
        (0,) * 7, (-90, 90, 90, -90, -90, 90, 0), (340, 0, 400, 0, 400, 0, 126), (0,) * 7,
    ),
    "Stanford arm": Table(
        "Paul, Robot Manipulators, 1981; lengths of Corke, Robotics Toolbox, mdl_stanford",
        (0, 0, 20.3, 0, 0, 0), (-90, 90, 0, -90, 90, 0), (412, 154, 0, 0, 0, 263), (0, 0, -90, 0, 0, 0), slides=(2,),
    ),
}  # fmt: skip


def product(table: Table, q: Array) -> Array:
    """Frames (n, 4, 4) of the flange at joint positions q (n, joints), rad and mm: textbook matrices, multiplied."""
    out = []
    for row in q:
        frame = np.eye(4)
        for k, (a, alpha, d, theta) in enumerate(zip(table.a, table.alpha, table.d, table.theta, strict=True)):
            slide = k in table.slides
            angle, along = math.radians(theta) + (0 if slide else row[k]), d + (row[k] if slide else 0)
            frame = frame @ (craig if table.modified else paul)(a, math.radians(alpha), along, angle)
        out.append(frame)
    return np.array(out)


def paul(a: float, alpha: float, d: float, theta: float) -> Array:
    """The matrix A of the standard convention, as Paul (1981) prints it."""
    c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def craig(a: float, alpha: float, d: float, theta: float) -> Array:
    """The matrix of the modified convention, as Craig (1986) prints it in equation 3.6."""
    c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -sa * d], [s * sa, c * sa, ca, ca * d], [0, 0, 0, 1]])


def frames(elements: Machine | tuple[Shape | Joint, ...], q: Array) -> Array:
    """Frames (n, 4, 4) of a machine's last member at joint positions, by the product's own kinematics."""
    machine = elements if isinstance(elements, Machine) else Machine("robot", elements)
    chain = Chain(nominal(machine, (0.0, 0.0, 0.0)))
    out = chain.kernel("nominal")(as_rows(*q.T, *np.zeros((3, len(q))))).T
    found = np.tile(np.eye(4), (len(q), 1, 1))
    found[:, :3, :3] = out[:, 3:].reshape(-1, 3, 3).transpose(0, 2, 1)
    found[:, :3, 3] = out[:, :3]
    return found


def positions(joints: Sequence[Joint], count: int, seed: int = 0) -> Array:
    """Random positions (count, joints) within the travels, mm and rad."""
    low, high = np.array([j.travel for j in joints]).T
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def read_text(text: str, form: str = "", base: str = "", tip: str = "", name: str = "robot.txt") -> Machine:
    """The machine of a description's text."""
    found = described(RawFile(Path(name), name, text.encode()), form, Part(base, tip))
    return Machine(found.name, found.elements)


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = "") -> str:
    """A joint of a URDF; `more` has its origin, axis and the like."""
    limit = '<limit lower="-1.5" upper="2.5" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{limit}{more}</joint>\n'


def robot(*joints: str, name: str = "arm", links: Sequence[str] = ()) -> str:
    """A URDF of these joints; links that no joint names may be added."""
    import re

    ends = dict.fromkeys([*re.findall(r'link="([^"]*)"', "".join(joints)), *links])
    return f'<robot name="{name}">\n' + "".join(f'<link name="{e}"/>\n' for e in ends) + "".join(joints) + "</robot>\n"
