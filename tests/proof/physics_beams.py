"""Beams, columns, rams and arms under gravity: Euler-Bernoulli and contact stiffness worked out by numbers."""

from __future__ import annotations

import numpy as np

from tests.proof.hidden import Hidden, Rng, Situation, motion, reach
from tests.proof.kinematics import Array, Chain, Motions, origins


def cantilever(length: float, tip: float, weight: float, stiffness: Array) -> tuple[float, float]:
    """Deflection and slope at the end of a cantilever of varying stiffness EI (from root to tip), by quadrature.

    `tip` is the load at the end, `weight` the load per length; of unit stiffness and uniform: P l^3/3 + w l^4/8.
    """
    x = np.linspace(0, length, len(stiffness))
    curvature = (tip * (length - x) + weight * (length - x) ** 2 / 2) / stiffness
    step = np.diff(x)
    slope = np.concatenate([[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * step)])
    bent = np.concatenate([[0], np.cumsum((slope[1:] + slope[:-1]) / 2 * step)])
    return float(bent[-1]), float(slope[-1])


def travelling_load(u: Array, clamp: float) -> tuple[Array, Array]:
    """Deflection and slope under a load travelling along a beam of unit length and stiffness.

    The ends turn against springs: `clamp` 0 is simply supported, 1 clamped. Solved by superposition of end moments.
    """
    a, b = u, 1 - u
    free, slope = a**2 * b**2 / 3, a * b * (b - a) / 3
    # end rotations of the free beam under the load, and moments that the springs answer with
    left, right = a * b * (1 + b) / 6, a * b * (1 + a) / 6
    m1, m2 = clamp * (4 * left - 2 * right), clamp * (4 * right - 2 * left)
    for m, s, ds in ((m1, a, 1.0), (m2, b, -1.0)):
        # deflection of a unit moment at the end s = 0: (2 s - 3 s^2 + s^3)/6, against the load's
        free = free - m * (2 * s - 3 * s**2 + s**3) / 6
        slope = slope - m * ds * (2 - 6 * s + 3 * s**2) / 6
    return free, slope


def ram_sag(chain: Chain, rng: Rng) -> Hidden | None:
    if "ram" not in chain.roles:
        return None
    ram = chain[chain.roles["ram"][0]]
    stub, tip, taper = rng.uniform(0.1, 0.35), rng.uniform(0.4, 2.0), rng.uniform(0.25, 0.6)
    give = rng.uniform(0.02, 0.1)  # of the guide, per moment
    ext = np.linspace(0, 1, 80)
    table = []
    for e in ext:
        whole = stub + e
        stiff = np.linspace(1.0, 1.0 - taper * whole / (stub + 1), 200)
        w, s = cantilever(whole, tip, 1.0, stiff)
        moment = tip * whole + whole**2 / 2
        table.append((w + give * moment * whole, s + give * moment))
    curve = np.array(table) - table[0]
    curve /= curve[-1, 0]

    def field(sit: Situation) -> Motions:
        u = sit.share(ram.name)
        w, s = np.interp(u, ext, curve[:, 0]), np.interp(u, ext, curve[:, 1])
        # out along +y: the end sinks, and the nose turns down about x
        return {ram.name: motion(len(sit), dz=-w, ea=-s / ram.length)}

    also = ("higher-order-geometry", "cross-axis-compliance", "column-bending")
    return Hidden("ram-sag", ("ram-sag", "telescoping-compliance"), (ram.name,), field, also=also)


def beam_sag(chain: Chain, rng: Rng) -> Hidden | None:
    if "beam" not in chain.roles:
        return None
    beam = chain[chain.roles["beam"][0]]
    clamp, off, follow = rng.uniform(0, 0.8), rng.uniform(-0.08, 0.08), rng.uniform(0.7, 1.1)
    top = float(travelling_load(np.array([0.5]), clamp)[0][0])

    def field(sit: Situation) -> Motions:
        u = 0.04 + 0.92 * sit.share(beam.name)
        w, s = travelling_load(u + off * u * (1 - u), clamp)
        tilt = follow * s / top / beam.length
        name = "eb" if abs(beam.axis[0]) > 0.5 else "ea"
        return {beam.name: motion(len(sit), dz=-w / top, **{name: tilt if name == "eb" else -tilt})}

    return Hidden("beam-sag", ("beam-sag",), (beam.name,), field, also=("higher-order-geometry",))


def beam_torsion(chain: Chain, rng: Rng) -> Hidden | None:
    if "beam" not in chain.roles:
        return None
    beam, load = (chain[n] for n in chain.roles["beam"])
    power, rest, lever = rng.uniform(0.8, 1.3), rng.uniform(0.2, 0.6), reach(chain)
    name = "ea" if abs(beam.axis[0]) > 0.5 else "eb"

    def field(sit: Situation) -> Motions:
        u, v = sit.share(beam.name), sit.share(load.name)
        twist = (rest + v) / (1 + rest) * (4 * np.clip(u * (1 - u), 0, None)) ** power
        return {beam.name: motion(len(sit), **{name: twist / lever})}

    return Hidden("beam-torsion", ("beam-torsion",), (beam.name,), field, also=("cross-axis-compliance",))


def column_bending(chain: Chain, rng: Rng) -> Hidden | None:
    if "column" not in chain.roles:
        return None
    column, load = (chain[n] for n in chain.roles["column"])
    root, shape, lever = rng.uniform(0.1, 0.5), rng.uniform(1.0, 1.4), reach(chain)
    about = np.cross(column.axis, load.axis)

    def field(sit: Situation) -> Motions:
        h, v = sit.share(column.name), 2 * sit.share(load.name) - 1
        moment = v + 0.12 * v**2
        tilt = moment * (root + h**shape) / (1 + root)
        bow = moment * (root * h + h ** (1 + shape) / (1 + shape)) / (1 + root) * column.length
        out = np.zeros((len(sit), 6))
        out[:, 3:] = tilt[:, None] * about / lever
        out[:, :3] = bow[:, None] * np.cross(about, column.axis) / lever
        return {column.name: out}

    accept = ("column-bending", "cross-axis-compliance")
    return Hidden("column-bending", accept, (column.name,), field, also=("ground-compliance",))


def cross_axis_compliance(chain: Chain, rng: Rng) -> Hidden | None:
    """A carriage turns gently as another one travels: softer on one side than on the other."""
    slides = list(chain.prismatic)
    if len(slides) < 2:
        return None
    one, other = (slides[k] for k in rng.permutation(len(slides))[:2])
    k, soft, lever = int(rng.integers(3)), rng.uniform(1.0, 2.2), reach(chain)

    def field(sit: Situation) -> Motions:
        v = 2 * sit.share(other.name) - 1
        turn = np.tanh(soft * v) / np.tanh(soft) + 0.25 * v**2
        return {one.name: motion(len(sit), **{f"e{'abc'[k]}": turn / lever})}

    also = ("column-bending", "ground-compliance", "beam-torsion", "gantry-racking", "higher-order-geometry")
    return Hidden("cross-axis-compliance", ("cross-axis-compliance",), (one.name,), field, also=also)


def telescoping(chain: Chain, rng: Rng) -> Hidden | None:
    if "ram" not in chain.roles:
        return None
    ram = chain[chain.roles["ram"][0]]
    longest, nose, lever = rng.uniform(1.12, 1.35), rng.uniform(0.3, 1.0), reach(chain)

    def tilt(u: Array) -> Array:
        overlap = longest - u
        out: Array = (0.4 * u + nose * u**1.2 + 0.15) / overlap**2.2
        return out

    top = float(tilt(np.ones(1))[0])

    def field(sit: Situation) -> Motions:
        return {ram.name: motion(len(sit), ea=-tilt(sit.share(ram.name)) / top / lever)}

    accept = ("telescoping-compliance", "ram-sag")
    return Hidden(
        "telescoping-compliance",
        accept,
        (ram.name,),
        field,
        also=("higher-order-geometry", "cross-axis-compliance", "column-bending"),
    )


def ground_compliance(chain: Chain, rng: Rng) -> Hidden | None:
    """The whole machine tilts on its feet, which are stiffer the more they carry, as its heaviest axis travels."""
    if not chain.prismatic or chain.elements[0].kind == "rotary":
        return None
    heavy = max(chain.prismatic, key=lambda e: e.length)
    if abs(heavy.axis[2]) > 0.5:
        return None
    name, hard, lever = "eb" if abs(heavy.axis[0]) > 0.5 else "ea", rng.uniform(0.1, 0.35), reach(chain)

    def field(sit: Situation) -> Motions:
        v = 2 * sit.share(heavy.name) - 1
        return {"frame": motion(len(sit), **{name: (v - hard * v**3 + 0.1 * v**2) / lever})}

    also = ("cross-axis-compliance", "higher-order-geometry", "column-bending")
    return Hidden("ground-compliance", ("ground-compliance",), ("frame", "instrument"), field, also=also)


def payload_sag(chain: Chain, rng: Rng) -> Hidden | None:
    if chain.rotary:  # the last member turns: down is not always down there
        return None
    last = chain.elements[-1]
    lever, stiffen = reach(chain), rng.uniform(0.75, 0.95)
    far = chain.prismatic[-1]

    def field(sit: Situation) -> Motions:
        m = (sit.path.load / 60.0) ** stiffen
        share = 0.3 + 0.7 * sit.share(far.name) ** 1.3
        return {last.name: motion(len(sit), dz=-m * share, ea=0.3 * m * share / lever)}

    return Hidden("payload-sag", ("payload-sag",), (last.name, far.name), field)


def joint_compliance(chain: Chain, rng: Rng) -> Hidden | None:
    """The gear of a shoulder or elbow winds up under the weight of all members behind it, harder at large torque."""
    if "arm" not in chain.roles:
        return None
    joint = chain[str(rng.choice(chain.roles["arm"]))]
    place = [e.name for e in chain.elements].index(joint.name)
    behind = chain.elements[place + 1 :]
    mass = {e.name: float(rng.uniform(0.4, 1.0)) * (0.8**k) for k, e in enumerate(behind) if e.kind == "shape"}
    hard, lever = rng.uniform(0.05, 0.2), reach(chain)

    def field(sit: Situation) -> Motions:
        places, turns, tip = origins(chain, sit.path.q, sit.path.tool)
        axis = turns[joint.name] @ np.array(joint.axis)
        torque = np.zeros(len(sit))
        before = places[joint.name]
        for name, m in mass.items():
            centre = (before + places[name]) / 2
            arm = centre - places[joint.name]
            torque += m * np.einsum("ni,ni->n", np.cross(arm, [0.0, 0.0, -1.0]), axis)
            before = places[name]
        torque += 0.8 * np.einsum("ni,ni->n", np.cross(tip - places[joint.name], [0.0, 0.0, -1.0]), axis)
        t = torque / (lever * (sum(mass.values()) + 0.8))
        out = np.zeros((len(sit), 6))
        out[:, 3:] = ((t - hard * t**3)[:, None] * np.array(joint.axis)) / lever
        return {joint.name: out}

    return Hidden("joint-compliance", ("joint-compliance",), (joint.name,), field, also=(), physical=6.0)


def gantry_racking(chain: Chain, rng: Rng) -> Hidden | None:
    """Two drives share friction unevenly; each has an encoder, and their difference is recorded."""
    if "dual" not in chain.roles:
        return None
    dual, across = (chain[n] for n in chain.roles["dual"])
    lever, drag, wave, phase = reach(chain), rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6), rng.uniform(0, 6)

    def yaw(sit: Situation) -> Array:
        u, v = sit.share(dual.name), 2 * sit.share(across.name) - 1
        slow = np.interp(sit.path.time, [0, sit.path.time[-1] / 3, sit.path.time[-1]], [0, 0.4, -0.1])
        out: Array = drag * sit.path.dirs[dual.name] * (1 + 0.4 * v) + wave * np.sin(9 * u + phase) + slow
        return out / lever

    def field(sit: Situation) -> Motions:
        return {dual.name: motion(len(sit), ec=yaw(sit))}

    def witness(sit: Situation, amplitude: float) -> dict[str, Array]:
        seen = amplitude * yaw(sit) * across.length
        noise = np.random.default_rng(len(sit)).normal(0, 0.02 * float(np.std(seen)) + 1e-5, len(sit))
        return {"w_sync": np.round(seen + noise + 0.0003, 6)}

    return Hidden("gantry-racking", ("gantry-racking",), (dual.name,), field, witness=witness)
