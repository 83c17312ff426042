"""Random machines, poses and error values, for tests that should hold for every chain."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, ROTATIONS, Motion
from errormodel.joint_models.first_order import FirstOrder
from errormodel.machine import Basis, Joint, Machine, Shape, Vector
from identification.observation.models import PositionView, fixed_tool

Array = NDArray[np.float64]

AXES: list[Vector] = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)]


def unit(vector: tuple[int, ...]) -> Vector:
    x, y, z = (v / float(np.linalg.norm(vector)) for v in vector)
    return x, y, z


# Whole numbers, and round ones: a machine a hair's breadth from a special one has no definite rank.
oblique = st.tuples(*[st.integers(-3, 3)] * 3).filter(any).map(unit)
lengths = st.integers(-80, 80).map(lambda n: 10.0 * n)
vectors = st.tuples(lengths, lengths, lengths)
angles = st.integers(-30, 30).map(lambda n: n / 10)
motions = st.one_of(st.just(MOTIONS), st.lists(st.sampled_from(MOTIONS), max_size=6, unique=True).map(tuple))


@st.composite
def joints(draw: st.DrawFn, name: str) -> Joint:
    rotary = draw(st.booleans())
    low, high = draw(st.integers(-20, 15)), draw(st.integers(1, 30))
    travel = (low / 10, (low + high) / 10 + 0.5) if rotary else (100.0 * low, 100.0 * (low + high))
    bare = Joint(name, "rotary" if rotary else "prismatic", draw(st.one_of(st.sampled_from(AXES), oblique)), travel)
    bases = [Basis("polynomial", draw(st.integers(1, 4))), Basis("spline", draw(st.integers(1, 5)))]
    bases += [Basis("harmonic", draw(st.integers(1, 3)))] if rotary else []
    models: dict[Motion, Basis] = {}
    for motion in draw(motions):
        first = [Basis("first-order")] if motion in FirstOrder.motions(bare) else []
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


def seen(chain: Chain, rows: list[Array], ids: tuple[str, ...] = (), **more: Any) -> PositionView:
    """Positions at poses, in a known measuring frame."""
    n, own = len(rows[0]), ids or chain.machine_ids
    given = {"whitener": np.ones(n), "index": np.arange(n), "measured": np.zeros((n, 3)), **more}
    return PositionView(
        kind="position", chain=chain, ids=own, columns=own, rows=rows, fixed=fixed_tool(chain, rows), **given
    )


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
