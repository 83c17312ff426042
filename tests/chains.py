"""Random machines, poses and error values, for tests that should hold for every chain."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, ROTATIONS, Motion
from errormodel.errorblock import first_order_motions
from errormodel.machine import Basis, Joint, Machine, Shape, Vector

Array = NDArray[np.float64]

AXES: list[Vector] = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)]


def unit(angles: tuple[float, float]) -> Vector:
    z, phi = angles
    r = float(np.sqrt(1 - z * z))
    return r * float(np.cos(phi)), r * float(np.sin(phi)), z


oblique = st.tuples(st.floats(-0.99, 0.99), st.floats(-3.1, 3.1)).map(unit)
lengths = st.one_of(st.just(0.0), st.floats(-800, 800))
vectors = st.tuples(lengths, lengths, lengths)
angles = st.one_of(st.just(0.0), st.floats(-3, 3))
motions = st.one_of(st.just(MOTIONS), st.lists(st.sampled_from(MOTIONS), max_size=6, unique=True).map(tuple))


@st.composite
def joints(draw: st.DrawFn, name: str) -> Joint:
    rotary = draw(st.booleans())
    low = draw(st.floats(-3, 1) if rotary else st.floats(-2000, 1500))
    high = low + draw(st.floats(0.5, 5) if rotary else st.floats(100, 3000))
    bare = Joint(name, "rotary" if rotary else "prismatic", draw(st.one_of(st.sampled_from(AXES), oblique)), (low, high))
    bases = [Basis("polynomial", draw(st.integers(1, 4))), Basis("spline", draw(st.integers(1, 5)))]
    bases += [Basis("harmonic", draw(st.integers(1, 3)))] if rotary else []
    models: dict[Motion, Basis] = {}
    for motion in draw(motions):
        first = [Basis("first-order")] if motion in first_order_motions(bare) else []
        models[motion] = draw(st.sampled_from(first + bases))
    return Joint(bare.name, bare.type, bare.axis, bare.travel, models)


@st.composite
def machines(draw: st.DrawFn, most_joints: int = 7) -> Machine:
    """One to seven joints of any kind and direction, shapes before, between and after them or not."""
    elements: list[Shape | Joint] = []
    for k in range(draw(st.integers(1, most_joints))):
        for name in draw(st.sampled_from([(), (f"S{k}",), (f"S{k}", f"R{k}")])):
            turned = draw(st.booleans())
            rotation = draw(st.tuples(angles, angles, angles)) if turned else (0.0, 0.0, 0.0)
            elements.append(Shape(name, draw(vectors), rotation, draw(motions)))
        elements.append(draw(joints(f"J{k}")))
    if draw(st.booleans()):
        elements.append(Shape("last", draw(vectors), (0.0, 0.0, 0.0), draw(motions)))
    return Machine("random", tuple(elements), draw(vectors))


def poses(machine: Machine, count: int, seed: int = 0, tools: tuple[Vector, ...] = ()) -> list[Array]:
    """Channels of random poses over the travels; tools by turns."""
    rng = np.random.default_rng(seed)
    commands = [rng.uniform(*joint.travel, count) for joint in machine.joints]
    tool = np.resize(np.array(tools or (machine.tool,)), (count, 3))
    return [*commands, *(np.ascontiguousarray(c) for c in tool.T)]


def errors(chain: Chain, seed: int = 0, um: float = 10.0, urad: float = 20.0) -> Array:
    """Values of the machine's own parameters, each a motion of about `um` or `urad` at its largest over the travel."""
    rng = np.random.default_rng(seed)
    p = np.zeros(len(chain.ids))
    own = chain.machine_ids
    if own:
        terms = chain.kernel("terms", own)(poses(chain.machine, 200), ()).reshape(-1, 6, 200)[: len(own)]
        for identity, term in zip(own, np.abs(terms).max(axis=2), strict=True):
            k = chain.index[identity]
            motion = chain.parameters[k].motion
            angle = motion in ROTATIONS
            largest = term[MOTIONS.index(motion)] if angle else term[:3].max()
            p[k] = rng.uniform(-1, 1) * (urad * 1e-6 if angle else um * 1e-3) / largest
    return p
