"""Random programmes that a machine of 600 x 300 x 200 mm can run, with all that the grammar takes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tests.helpers.chains import Array

LOW, HIGH = np.array([-150.0, 20.0, -230.0]), np.array([350.0, 280.0, -70.0])
OFFSETS = {
    "G54": {"X": 100.0, "Y": 150.0, "Z": -150.0},
    "G57": {"X": 20.5, "Y": 31.25, "Z": -200.0},
    "H3": {"Z": 40.125},
}
PLANES = {17: (0, 1, "IJ"), 18: (2, 0, "KI"), 19: (1, 2, "JK")}


@dataclass
class Author:
    """Writes one programme, and knows where its axes stand."""

    seed: int
    printer: bool = False
    lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.at = np.full(3, np.nan)
        self.inch = self.relative = self.centres = self.timed = False
        self.plane, self.origin, self.tool = 17, "", ""
        self.motion, self.height = "", 0.0
        self.filament_relative, self.filament = False, 0.0
        self.number = 10

    def text(self) -> str:
        head = "G21 G90 G17 G94 G40 G80 F600" if not self.printer else "G21"
        self.lines += ["%", head] if not self.printer else [head, "G90"]
        if self.printer:
            self.filament_relative = self.chance(0.5)
            self.lines += ["M83" if self.filament_relative else "M82", "M104 S210", "G92 E0", "G28"]
        self.origins()
        for _ in range(self.rng.integers(4, 12)):
            self.block()
        self.lines += ["M30", "%"] if not self.printer else ["M84"]
        return "\n".join(self.lines) + "\n"

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def shift(self) -> Array:
        return np.array(
            [OFFSETS.get(self.origin, {}).get(a, 0.0) + OFFSETS.get(self.tool, {}).get(a, 0.0) for a in "XYZ"]
        )

    def origins(self) -> None:
        self.origin = "" if self.printer else str(self.rng.choice(["G54", "G57"]))
        first = self.target([0, 1, 2])
        if self.origin:
            self.lines.append(self.origin)
        if self.chance(0.5):
            self.rapid(first, [0, 1])
            self.rapid(first, [2])
        else:
            self.rapid(first, [0, 1, 2])

    def target(self, columns: list[int]) -> Array:
        out = self.at.copy()
        near = self.chance(0.75) and np.isfinite(self.at).all()
        for k in columns:
            low, high = (max(LOW[k], self.at[k] - 8), min(HIGH[k], self.at[k] + 8)) if near else (LOW[k], HIGH[k])
            out[k] = self.rng.uniform(low, high)
        return out

    def word(self, column: int, goal: Array, absolute: bool | None = None) -> str:
        """An axis word, and the axis brought to just where it says."""
        unit = 25.4 if self.inch else 1.0
        free = self.relative if absolute is None else not absolute
        base = self.at[column] if free else self.shift()[column]
        digits = 4 if self.inch else 3
        number = round((goal[column] - base) / unit, digits)
        goal[column] = number * unit + base
        text = f"{number:.{digits}f}"
        style = self.rng.integers(3)
        text = text.rstrip("0") if style == 0 else text
        text = text.lstrip("0") if style == 1 and number >= 0 and number < 1 and text.strip("0.") else text
        letter = "XYZ"[column]
        return (letter.lower() if self.chance(0.05) and not self.printer else letter) + text

    def columns(self) -> list[int]:
        return sorted(self.rng.choice(3, self.rng.integers(1, 4), replace=False).tolist())

    def send(self, code: str, words: list[str], more: str = "") -> None:
        said = code if code != self.motion or self.chance(0.5) or self.printer else ""
        self.motion = code
        label = ""
        if self.chance(0.3) and not self.printer:
            label, self.number = f"N{self.number} ", self.number + 10
        gap = " " if self.chance(0.8) or self.printer else ""
        self.lines.append((label + gap.join(w for w in [said, *words] if w) + more).rstrip())

    def rapid(self, goal: Array, columns: list[int]) -> None:
        goal = np.where(np.isin(np.arange(3), columns), goal, self.at)
        if self.relative and not np.isfinite(self.at).all():
            return
        words = [self.word(k, goal) for k in columns]
        self.at = goal
        self.send("G0", words)

    def feed(self, length: float) -> list[str]:
        if self.timed:
            return [f"F{self.rng.uniform(0.5, 40):.3f}"]
        return [f"F{self.rng.integers(100, 3000)}"] if self.chance(0.3) else []

    def filaments(self, length: float) -> list[str]:
        if not self.printer or self.chance(0.2):
            return []
        amount = round(length * 0.0333, 5)
        value = amount if self.filament_relative else round(self.filament + amount, 5)
        self.filament = value if not self.filament_relative else 0.0
        return [f"E{value:.5f}"]

    def cut(self) -> None:
        columns = self.columns()
        goal = self.target(columns)
        small = np.abs(goal - self.at) < 2.0
        goal = np.where(
            small & np.isin(np.arange(3), columns), np.where(self.at > (LOW + HIGH) / 2, self.at - 3, self.at + 3), goal
        )
        start = self.at
        words = [self.word(k, goal) for k in columns]
        if np.isin(np.round(np.abs(goal - start), 9), [0.0]).all():
            return
        length = float(np.linalg.norm(goal - start))
        self.at = goal
        tail = " (cut)" if self.chance(0.1) and not self.printer else " ;cut" if self.chance(0.1) else ""
        self.send(
            "G1",
            [
                *words,
                *self.filaments(length),
                *self.feed(length),
                *(["M8"] if self.chance(0.05) and not self.printer else []),
            ],
            tail,
        )

    def arc(self) -> None:
        i, j, letters = PLANES[self.plane]
        k = 3 - i - j
        radius = float(self.rng.uniform(*((0.5, 3.0) if self.chance(0.85) else (3.0, 12.0))))
        if min(self.at[i] - LOW[i], HIGH[i] - self.at[i], self.at[j] - LOW[j], HIGH[j] - self.at[j]) < 25:
            return
        toward = self.rng.uniform(0, 2 * math.pi)
        centre = self.at[[i, j]] + radius * np.array([math.cos(toward), math.sin(toward)])
        clockwise, full = self.chance(0.5), self.chance(0.2)
        angle = float(self.rng.uniform(0.2, 5.8)) * (-1 if clockwise else 1)
        goal = self.at.copy()
        if not full:
            turned = toward + math.pi + angle
            goal[i], goal[j] = centre[0] + radius * math.cos(turned), centre[1] + radius * math.sin(turned)
        helix = self.chance(0.3)
        if helix:
            goal[k] += self.rng.uniform(1, 8) * (-1 if goal[k] > (LOW[k] + HIGH[k]) / 2 else 1)
        start = self.at
        columns = sorted(({i, j} if not full or self.relative else set()) | ({k} if helix else set()))
        if full and self.relative:
            columns = [k] if helix else []
        words = [self.word(c, goal) for c in columns]
        unit, digits = (25.4, 4) if self.inch else (1.0, 3)
        code = "G2" if clockwise else "G3"
        if not full and self.chance(0.3) and abs(angle) < 2.8:
            chord = float(np.hypot(*(goal - start)[[i, j]]))
            words.append(f"R{max(radius, chord / 2 * 1.02) / unit:.{digits}f}")
        else:
            base = self.shift()[[i, j]] if self.centres else start[[i, j]]
            words += [f"{c}{v:.{digits}f}" for c, v in zip(letters, (centre - base) / unit, strict=True)]
        length = abs(angle) * radius
        self.at = goal
        self.send(code, [*words, *self.filaments(length), *self.feed(length)])

    def block(self) -> None:
        pick = self.rng.random()
        if pick < 0.35:
            self.cut()
        elif pick < 0.55:
            self.arc()
        elif pick < 0.72:
            columns = self.columns()
            self.rapid(self.target(columns), columns)
        else:
            self.mode()

    def mode(self) -> None:
        if self.printer:
            self.lines.append(
                str(self.rng.choice(["M106 S255", "M107", ";TYPE:SKIN", "G4 P10", "M117 Layer 2", "M204 S500"]))
            )
            return
        pick = self.rng.integers(10)
        if pick == 0:
            self.inch = not self.inch
            self.lines.append("G20" if self.inch else "g21")
        elif pick == 1:
            self.relative = not self.relative
            self.lines.append("G91" if self.relative else "G90")
        elif pick == 2:
            self.centres = not self.centres
            self.lines.append("G90.1" if self.centres else "G91.1")
        elif pick == 3:
            self.timed = not self.timed
            self.lines.append("G93" if self.timed else "G94 F500")
        elif pick == 4:
            self.plane = int(self.rng.choice([17, 18, 19]))
            self.lines.append(f"G{self.plane}")
        elif pick == 5:
            self.origin = str(self.rng.choice(["G54", "G57"]))
            self.lines.append(self.origin)
        elif pick == 6 and not self.relative:
            goal = self.target([2])
            self.tool = "" if self.tool else "H3"
            word = self.word(2, goal)
            self.at = goal
            self.motion = "G0"
            self.lines.append(f"G0 G43 H3 {word}" if self.tool else f"G49 G0 {word}")
        elif pick == 7 and not self.relative:
            unit = 25.4 if self.inch else 1.0
            value = round(float(self.rng.uniform(LOW[2], HIGH[2])) / unit, 4)
            self.at = np.array([*self.at[:2], value * unit])
            self.motion = "G0"
            self.lines.append(f"G0 G53 Z{value:.4f}")
        elif pick == 8:
            self.lines.append(
                str(
                    self.rng.choice(["/M8", "M9", "(a comment)", "; another", "S4000 M3", "G4 P1", "/ M0", "G64 P0.01"])
                )
            )
        else:
            self.lines.append(str(self.rng.choice(["M5", "M1", "T4", "", "   ", "N5 M7"])))
