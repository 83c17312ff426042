"""How far float64 answers are from exact ones: M itself, and fits at full travel and where commands hardly move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tests.benchmarks import five_axis, reference
from tests.benchmarks.five_axis import IDS, Array


def design_error(design: Array, ids: tuple[str, ...], q: Array) -> float:
    """Largest error of M (n, 3, len(ids)), relative to the largest entry of its column (of M where that is zero)."""
    exact = _exact_columns(q, ids)
    size = np.abs(exact).max(axis=(0, 1))
    return float((np.abs(design - exact) / np.where(size > 0, size, size.max())).max())


def _exact_columns(q: Array, ids: tuple[str, ...]) -> Array:
    """M rounded once, those of the measuring frame (Pinocchio's first six) included."""
    frame = tuple(f"frame.{motion}" for motion in five_axis.MOTIONS)
    point = np.array(reference.nominal(q), dtype=float)
    lever = np.cross(np.eye(3), point[:, None, :]).transpose(0, 2, 1)
    shift = np.broadcast_to(np.eye(3), lever.shape)
    everything = np.concatenate([np.array(reference.design(q), dtype=float), shift, lever], axis=2)
    return everything[:, :, [(*IDS, *frame).index(identity) for identity in ids]]


class Problem:
    """A small survey over the middle `share` of every travel, and the exact answers to it.

    Two questions are asked. ``fit``: parameters from commands and measured positions, both taken as exact; whoever
    forms actual minus nominal in float64 loses some 1e-12 there, before anything is solved. ``solve``: parameters from
    commands and volumetric errors; what is lost is the solver's.
    """

    def __init__(self, poses: int, share: float) -> None:
        self.q = five_axis.poses(poses, share)
        self._exact = reference.design(self.q)
        self.design = np.array(self._exact, dtype=float)
        self.measured = five_axis.measured(self.q, self.design)
        self.errors = self.measured - five_axis.nominal(self.q)
        self._answers: dict[tuple[str, tuple[str, ...]], Array] = {}

    def error(self, question: str, contender: Callable[[Array, Array], dict[str, Any]]) -> dict[str, float]:
        """``error``: ``|D (p - p*)| / |D p*|``, p found by the contender, p* exact, D the norms of its columns.

        ``rank`` is how many columns the contender held to be independent; p* is the answer for the same ones.
        """
        found = contender(self.q, self.measured if question == "fit" else self.errors)
        ids = tuple(found["ids"])
        exact = self._answer(question, ids)
        missed = self._scale(ids) * np.asarray(found["values"]) - exact
        return {"error": float(np.linalg.norm(missed) / np.linalg.norm(exact)), "rank": len(ids)}

    def _answer(self, question: str, ids: tuple[str, ...]) -> Array:
        if (question, ids) not in self._answers:
            rows = [[row[c] for c in _places(ids)] for pose in self._exact for row in pose]
            right = [reference.number(v) for v in (self.measured if question == "fit" else self.errors).ravel()]
            if question == "fit":
                nominal = [v for point in reference.nominal(self.q) for v in point]
                right = [m - v for m, v in zip(right, nominal, strict=True)]
            self._answers[question, ids] = reference.least_squares(rows, right, self._scale(ids))
        return self._answers[question, ids]

    def _scale(self, ids: tuple[str, ...]) -> Array:
        return np.linalg.norm(self.design[:, :, _places(ids)], axis=(0, 1))


def _places(ids: Sequence[str]) -> list[int]:
    return [IDS.index(identity) for identity in ids]
