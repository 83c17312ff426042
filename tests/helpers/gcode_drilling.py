"""Random programmes of canned cycles and O-word calls, as LinuxCNC and the like take them."""

from __future__ import annotations

import numpy as np

NEED = {"G81": "", "G82": " P0.5", "G85": "", "G89": " P0.25", "G83": " Q{q}", "G73": " Q{q}"}


def drilling(seed: int) -> str:
    """A programme of some series of holes, in mm or inches, absolute or in increments, part of them in a call."""
    rng = np.random.default_rng(seed)
    inch = bool(rng.random() < 0.3)
    unit = 25.4 if inch else 1.0

    def mm(value: float) -> str:
        return f"{value / unit:.{4 if inch else 3}f}"

    body = ["G54", "G0 X0 Y0 Z" + mm(60)]
    for _ in range(int(rng.integers(1, 4))):
        body += series(rng, mm)
    lines = ["G21 G90 G17 G94 F300" if not inch else "G20 G90 G17 G94 F12"]
    if rng.random() < 0.5:
        name = str(rng.choice(["100", "<holes>"]))
        times = int(rng.integers(1, 3))
        return "\n".join([f"o{name} sub", *body, f"O{name} endsub", *lines, *[f"O{name} call"] * times, "M2"]) + "\n"
    return "\n".join([*lines, *body, "M2"]) + "\n"


def series(rng: np.random.Generator, mm) -> list[str]:  # type: ignore[no-untyped-def]
    """A series of holes, closed by G80 or by another motion."""
    code = str(rng.choice(list(NEED)))
    back = str(rng.choice(["G98", "G99"]))
    q = mm(float(rng.uniform(2, 6)))
    out = ["G90 G0 X" + mm(rng.uniform(-50, 50)) + " Y" + mm(rng.uniform(-50, 50)), "G0 Z" + mm(rng.uniform(40, 60))]
    if rng.random() < 0.4:
        places = f"X{mm(rng.uniform(-5, 5))} Y{mm(rng.uniform(-5, 5))}"
        levels = f"Z{mm(-rng.uniform(3, 20))} R{mm(-rng.uniform(1, 30))}"
        repeats = f" L{rng.integers(1, 4)}" if rng.random() < 0.7 else ""
        out.append(f"G91 {back} {code} {places} {levels}{NEED[code].format(q=q)}{repeats}")
        if back == "G98":
            out += [f"X{mm(rng.uniform(-9, 9))}" for _ in range(int(rng.integers(0, 3)))]
        return [*out, "G80", "G90"]
    out.append(
        f"{back} {code} X{mm(rng.uniform(-50, 50))} Z{mm(rng.uniform(-5, 5))} R{mm(rng.uniform(10, 35))}"
        f"{NEED[code].format(q=q)} F{mm(rng.uniform(100, 400))}"
    )
    lowest = 9.9
    for _ in range(int(rng.integers(0, 4))):
        pick = rng.random()
        line = f"X{mm(rng.uniform(-50, 50))}" + (f" Y{mm(rng.uniform(-50, 50))}" if rng.random() < 0.5 else "")
        if pick < 0.2:
            lowest -= rng.uniform(0.1, 0.6)
            line += f" R{mm(lowest)}"
        elif pick < 0.3:
            line += f" Z{mm(rng.uniform(-9, -5))}"
        elif pick < 0.4:
            back = "G99" if back == "G99" else str(rng.choice(["G98", "G99"]))
            line = f"{back} {line}"
        out.append(line)
    return [*out, "G80"] if rng.random() < 0.7 else [*out, "G0 X0"]
