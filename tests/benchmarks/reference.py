"""Answers to 60 digits (mpmath): M of a few poses, and the least-squares solution of a small survey.

The chain is written once more, for numbers of any precision, so that nobody checks himself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpmath import mp, mpf

from tests.benchmarks.five_axis import IDS, JOINTS, TOOL, Array

mp.dps = 60
_UNITS = [[mpf(int(i == k)) for i in range(3)] for k in range(3)]


def number(value: float) -> mpf:
    """A double as it is, to the last bit."""
    return mpf(float(value))


def design(q: Array) -> list[list[list[mpf]]]:
    """M exactly, for the doubles in `q`: (n, 3, 52)."""
    return [_transposed(_columns([number(v) for v in command])) for command in q]


def nominal(q: Array) -> list[list[mpf]]:
    """Nominal positions, (n, 3) mm."""
    return [_behind([number(v) for v in command], 0) for command in q]


def least_squares(rows: Sequence[Sequence[mpf]], e: Sequence[mpf], scale: Array) -> Array:
    """Exact least-squares solution, times `scale`: with 60 digits even normal equations are exact."""
    scales = [number(s) for s in scale]
    columns = [[v / s for v in column] for column, s in zip(zip(*rows, strict=True), scales, strict=True)]
    m = len(columns)
    normal = mp.matrix(m, m)
    for i in range(m):
        for k in range(i, m):
            normal[i, k] = normal[k, i] = mp.fdot(columns[i], columns[k])
    right = mp.matrix([mp.fdot(column, e) for column in columns])
    return np.array([float(v) for v in mp.cholesky_solve(normal, right)])


def _columns(q: list[mpf]) -> list[list[mpf]]:
    columns: list[list[mpf]] = []
    frame = _UNITS  # axes of the element's frame, in those of the reference
    for k, (_, kind, direction, _) in enumerate(JOINTS):
        axis = [mpf(a) for a in direction]
        behind = _behind(q, k + 1)  # the point, seen from behind joint k
        if kind == "rotary":
            lever = _rotated(axis, q[k], behind)
            half = mp.sin(q[k] / 2)
            motions = [_scaled(half, u) for u in _UNITS] + [_scaled(half, _cross(u, lever)) for u in _UNITS]
        else:
            motions = [_scaled(q[k], axis)]
            for u in _UNITS:
                bend = _scaled(q[k] ** 2 / 2, _cross(u, axis))
                motions.append([a + b for a, b in zip(bend, _scaled(q[k], _cross(u, behind)), strict=True)])
        columns += [_in_frame(frame, v) for v in motions]
        if kind == "rotary":
            frame = [_in_frame(frame, _rotated(axis, q[k], u)) for u in _UNITS]
        columns += [_in_frame(frame, v) for v in [*_UNITS, *(_cross(u, behind) for u in _UNITS)]]
    assert len(columns) == len(IDS)
    return columns


def _behind(q: list[mpf], first: int) -> list[mpf]:
    """The functional point as seen from in front of joint `first`."""
    point = [mpf(t) for t in TOOL]
    for k in range(len(JOINTS) - 1, first - 1, -1):
        _, kind, direction, _ = JOINTS[k]
        axis = [mpf(a) for a in direction]
        if kind == "rotary":
            point = _rotated(axis, q[k], point)
        else:
            point = [v + q[k] * a for v, a in zip(point, axis, strict=True)]
    return point


def _rotated(axis: list[mpf], angle: mpf, v: list[mpf]) -> list[mpf]:
    once = _cross(axis, v)
    twice = _cross(axis, once)
    return [a + mp.sin(angle) * b + (1 - mp.cos(angle)) * c for a, b, c in zip(v, once, twice, strict=True)]


def _cross(a: list[mpf], b: list[mpf]) -> list[mpf]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _scaled(factor: mpf, v: list[mpf]) -> list[mpf]:
    return [factor * a for a in v]


def _in_frame(frame: list[list[mpf]], v: list[mpf]) -> list[mpf]:
    return [mp.fdot((axis[r] for axis in frame), v) for r in range(3)]


def _transposed(columns: list[list[mpf]]) -> list[list[mpf]]:
    return [list(row) for row in zip(*columns, strict=True)]
