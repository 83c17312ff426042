"""Nominal machine in parallel projection: members as bars, linear axes as rails, rotary axes as rings."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from errormodel.chain import Chain
from errormodel.machine import Joint
from identification.plots import style, symbols

Array = NDArray[np.float64]

# Seen from the right, the front and above, 30 degrees down. Turned by 35 degrees rather than an isometric view's 45, as
# otherwise members with equal offsets in x and y fall on one another.
_VIEW_TURN, _VIEW_TILT = math.radians(35), math.radians(30)
VIEW = np.array(
    [
        [math.cos(_VIEW_TURN), math.sin(_VIEW_TURN), 0.0],
        [
            -math.sin(_VIEW_TURN) * math.sin(_VIEW_TILT),
            math.cos(_VIEW_TURN) * math.sin(_VIEW_TILT),
            math.cos(_VIEW_TILT),
        ],
    ]
)


def draw_machine(page: Axes, chain: Chain, box: tuple[float, float, float, float]) -> float:
    """Draw the machine into `box` (left, bottom, width, height) of a page whose unit is the inch.

    Linear axes stand at mid-travel, rotary axes at zero (or as near as their travel comes). Returns inches per mm.
    """
    drawing = _Drawing(page, chain, box)
    for place, element in enumerate(chain.machine.elements):
        if isinstance(element, Joint):
            (drawing.rail if element.type == "prismatic" else drawing.ring)(place, element)
        else:
            drawing.member(place, element.name)
    drawing.ends()
    drawing.write_labels()
    return drawing.scale


class _Drawing:
    """The drawing so far; all plotted points are kept, since labels must avoid them."""

    def __init__(self, page: Axes, chain: Chain, box: tuple[float, float, float, float]) -> None:
        self.page = page
        at = {
            j.name: sum(j.travel) / 2 if j.type == "prismatic" else float(np.clip(0, *j.travel))
            for j in chain.machine.joints
        }
        self.frames = chain.frames(at)
        self.tip = self.frames[-1, :3] @ (*chain.machine.tool, 1.0)
        corners = [self.frames[:, :3, 3], self.tip[None]]
        corners += [np.array(self._travel(k, e)) for k, e in enumerate(chain.machine.elements) if isinstance(e, Joint)]
        flat = np.concatenate(corners) @ VIEW.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        margin = 0.65  # inches, for rings and labels
        self.scale = float(np.min((np.array(box[2:]) - 2 * margin) / np.maximum(high - low, 1.0)))
        self.shift = np.array(box[:2]) + np.array(box[2:]) / 2 - self.scale * (low + high) / 2
        self.ink: list[Array] = []
        self.labels: list[tuple[str, Array, str, bool]] = []

    def flat(self, points: Array) -> Array:
        """Points (..., 3) in mm on the page, inches."""
        return np.asarray(self.scale * points @ VIEW.T + self.shift)

    def line(self, points: Array, colour: str, width: float, **more: object) -> Array:
        on_page = self.flat(points)
        self.page.plot(*on_page.T, color=colour, lw=width, **more)  # type: ignore[arg-type]
        for a, b in pairwise(on_page):
            self.ink.append(a + np.linspace(0, 1, 2 + int(np.hypot(*(b - a)) / 0.05))[:, None] * (b - a))
        return on_page

    def head(self, line: Array, size: float, colour: str) -> Array:
        """An arrow's head at the end of a line on the page; returns its tip."""
        along = (line[-1] - line[0]) / np.hypot(*(line[-1] - line[0]))
        symbols.head(self.page, line[-1], along, size, colour)
        reach = np.linspace(0, size, 4)[:, None]
        self.ink += [
            line[-1] + reach * along + side * (size - reach) * along[::-1] * (-1, 1) for side in (-0.4, 0, 0.4)
        ]
        return np.asarray(line[-1] + size * along)

    def mark(self, spot: Array, marker: str, colour: str) -> None:
        self.page.plot(*spot, marker, color=colour, ms=9, mec="white", mew=1, zorder=7)
        self.ink.append(spot + 0.07 * np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]))

    def _travel(self, place: int, joint: Joint) -> tuple[Array, Array]:
        frame = self.frames[place]
        along = frame[:3, :3] @ joint.axis
        reach = joint.travel if joint.type == "prismatic" else (0.0, 0.0)
        return frame[:3, 3] + reach[0] * along, frame[:3, 3] + reach[1] * along

    def rail(self, place: int, joint: Joint) -> None:
        colour = symbols.axis_colour(joint.axis)
        here, carriage = self.frames[place, :3, 3], self.frames[place + 1, :3, 3]
        self.line(np.array([here, carriage]), style.MUTED, 1.2, ls=(0, (1, 1.5)), zorder=2)
        ends = self.line(np.array(self._travel(place, joint)), colour, 5, alpha=0.55, solid_capstyle="butt", zorder=3)
        self.mark(self.flat(carriage), "s", colour)
        self.labels.append((joint.name, self.head(ends, 0.22, colour), colour, True))

    def ring(self, place: int, joint: Joint) -> None:
        colour = symbols.axis_colour(joint.axis)
        frame, inch = self.frames[place], 1 / self.scale
        axis = frame[:3, :3] @ joint.axis
        side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        side /= np.linalg.norm(side)
        turn = np.radians(np.linspace(20, 320, 60))[:, None]
        circle = frame[:3, 3] + 0.26 * inch * (np.cos(turn) * side + np.sin(turn) * np.cross(axis, side))
        on_page = self.line(circle, colour, 2, zorder=6)
        self.head(on_page[-2:], 0.14, colour)
        ends = self.line(frame[:3, 3] + inch * np.array([[-0.4], [0.55]]) * axis, colour, 1.4, zorder=6)
        self.labels.append((joint.name, self.head(ends, 0.14, colour), colour, True))

    def member(self, place: int, name: str) -> None:
        ends = self.frames[place : place + 2, :3, 3]
        if np.ptp(ends, axis=0).max() * self.scale > 0.02:
            on_page = self.line(ends, style.MUTED, 3.5, solid_capstyle="round", zorder=4)
            self.labels.append((name, on_page.mean(axis=0), style.MUTED, False))

    def ends(self) -> None:
        """Reference on the workpiece, as a hatched plate, and the tool."""
        table = 0.22 / self.scale * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]])
        self.page.add_patch(Polygon(self.flat(table), fc="white", ec=style.FAINT, hatch="////", zorder=1))
        self.line(table, style.INK, 1.2, zorder=1)
        self.labels.append(("workpiece", self.flat(np.zeros(3)), style.INK, True))
        self.line(np.array([self.frames[-1, :3, 3], self.tip]), style.INK, 3, zorder=5)
        on_page = self.flat(self.tip)
        self.mark(on_page, "o", style.ACCENT)
        self.labels.append(("tool point", on_page, style.ACCENT, True))

    def write_labels(self) -> None:
        """Labels at the places of least overlap, joints first; a thin line connects each to its element."""
        taken: list[tuple[Array, Array]] = []
        ink = np.concatenate(self.ink)
        circle = np.radians(np.arange(0, 360, 15))
        radii = np.repeat(np.arange(0.16, 1.4, 0.08), len(circle))
        around = radii[:, None] * np.tile(
            np.column_stack([np.cos(circle), np.sin(circle)]), (len(radii) // len(circle), 1)
        )
        halo = {"fc": "white", "ec": "none", "alpha": 0.7, "pad": 0.5}
        for text, anchor, colour, bold in sorted(self.labels, key=lambda label: not label[3]):
            size = style.HEADING if bold else style.BODY_TEXT
            half = np.array([0.33 * len(text) + 0.5, 0.9]) * size / 72
            spots = anchor + around
            near = [np.abs(ink[:, k] - spots[:, k, None]) < half[k] for k in (0, 1)]
            covered = (near[0] & near[1]).sum(axis=1)
            clashes = sum(((np.abs(c - spots) < h + half).all(axis=1) for c, h in taken), np.zeros(len(spots)))
            best = int(np.argmin(radii + 0.3 * covered + 50 * clashes))
            radius, centre = radii[best], spots[best]
            taken.append((centre, half))
            if radius > 0.45:
                self.page.plot(*np.array([anchor, centre]).T, color=style.FAINT, lw=0.8, zorder=1)
            look = {"size": size, "weight": "bold" if bold else "normal", "color": colour, "bbox": halo}
            self.page.text(centre[0], centre[1], text, ha="center", va="center", zorder=9, **look)  # type: ignore[arg-type]
