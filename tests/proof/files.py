"""The files a user would have: machine.yaml, survey.csv (and survey.yaml), heldout.csv."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.proof.hidden import Situation
from tests.proof.kinematics import Array, Chain, Element
from tests.proof.noise import Noise
from tests.proof.seal import write_atomic

Columns = dict[str, Array | list[str]]


def machine_yaml(chain: Chain, name: str) -> str:
    """The machine as its engineer believes it."""
    lines = ["errormodel: 1", f"name: {name}", "units: {length: mm, angle: deg}", "chain:"]
    lines += [f"  - {_element(e)}" for e in chain.elements]
    lines += [f"tool: {list(chain.tools[0])}", "errors:", "  shapes: all", "  joints:"]
    for j in chain.joints:
        kind, order = j.model
        lines.append(f"    {j.name}: {kind if kind == 'first-order' else f'{{{kind}: {order}}}'}")
    return "\n".join(lines) + "\n"


def _element(e: Element) -> str:
    if e.kind == "shape":
        turn = f", rotation: {np.degrees(e.rotation).tolist()}" if any(e.rotation) else ""
        return f"{{shape: {e.name}, offset: {list(e.offset)}{turn}}}"
    travel = [round(float(t), 6) for t in (np.degrees(e.travel) if e.kind == "rotary" else e.travel)]
    return f"{{joint: {e.name}, type: {e.kind}, axis: {list(e.axis)}, travel: {travel}}}"


def columns(sit: Situation, bare: bool, witness: dict[str, Array], dead: dict[str, float]) -> Columns:
    """All columns of commands; a bare plan has positions and the tool only."""
    path, world = sit.path, sit.world
    out: Columns = {}
    for j in sit.chain.joints:
        q = path.q[j.name]
        out[j.name] = np.round(np.degrees(q), 3) if j.kind == "rotary" else q
    for k, axis in enumerate("xyz"):
        out[f"tool_{axis}"] = path.tool[:, k]
    if bare:
        return out
    out["run"] = ["1"] * len(path)
    out["time"] = path.time
    for j in sit.chain.joints:
        out[f"dir_{j.name}"] = path.dirs[j.name].astype(int)
    for name, history in world.sensors.items():
        out[name] = np.round(sit.now(history), 2) if name not in dead else np.full(len(path), dead[name])
    out["feed"], out["load"] = path.feed, path.load
    for name, history in world.idle.items():
        out[name] = np.round(sit.now(history), 3)
    out.update(witness)
    return out


def write_csv(path: Path, table: Columns) -> None:
    """Write columns as a CSV file."""
    rows = zip(*(c if isinstance(c, list) else c.tolist() for c in table.values()), strict=True)
    lines = [",".join(table), *(",".join(str(v) for v in row) for row in rows)]
    write_atomic(path, "\n".join(lines) + "\n")


def survey_yaml(noise: Noise) -> str:
    """The survey with its instrument, where that is declared; the tracker stands in the measuring frame's origin."""
    beam = f"range: [{noise.beam[0]:.6g}, {noise.beam[1]:.6g}], angle: {noise.angle:.6g}"
    return (
        "errormodel: 1\nfiles:\n  - {path: survey.csv, role: fit}\nframe: shared\n"
        f"instrument: {{type: laser-tracker, station: [0, 0, 0], {beam}}}\n"
    )
