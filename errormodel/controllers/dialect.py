"""Syntax of a control's programmes, as far as the polarity check needs it: slow straight moves of one axis.

Every position is a machine coordinate, every move is straight, of one axis and at a stated feed; there are no rapids.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from errormodel.controllers.text import Comment


@dataclass(frozen=True)
class Move:
    """One axis to a machine position (mm) at a feed (mm/min), and why."""

    axis: str
    to: float
    feed: float
    why: str


@dataclass(frozen=True)
class Dialect:
    """Syntax of a short programme on a control.

    Attributes
    ----------
    suffix : suffix of the programme's file.
    comment : comment syntax.
    move : format of a straight move of one axis to a machine coordinate, with `axis`, `to` (mm) and `feed` (mm/min).
    end : last lines.
    source : documentation it is taken from, and parts without a source.
    opening : lines before any comment, formats with the programme's `name` and `number`.
    head : lines that set the modal state.
    stop : line that waits for the operator.
    needs : preparations by the operator, in words.
    block : prefix of each line, a format with its number `n`.
    radii : word that makes an X of diameters count radii; empty: none is known.
    """

    suffix: str
    comment: Comment
    move: str
    end: tuple[str, ...]
    source: str
    opening: tuple[str, ...] = ()
    head: tuple[str, ...] = ()
    stop: str = "M0"
    needs: tuple[str, ...] = ()
    block: str = ""
    radii: str = ""

    def prepare(self, numbers: Mapping[str, int]) -> list[str]:
        """Lines that set the modal state; `numbers` of its axes, by letter."""
        return list(self.head)

    def programme(
        self, name: str, number: int, said: Sequence[str], moves: Sequence[Move], numbers: Mapping[str, int]
    ) -> str:
        """Text of the programme: comments `said`, a stop, and the moves, each preceded by its reason."""

        def named(lines: Sequence[str]) -> list[str]:
            return [line.format(name=name, number=number) for line in lines]

        lines = [*named(self.opening), *self.comment.lines([*self.needs, *said], 70), self.stop, *self.prepare(numbers)]
        for move in moves:
            lines += self.comment.lines([move.why], 70)
            lines.append(self.move.format(axis=move.axis, to=move.to, feed=move.feed))
        lines += named(self.end)
        return "\n".join(f"{self.block.format(n=n)}{line}" for n, line in enumerate(lines)) + "\n"


RS274 = Dialect(
    suffix=".ngc",
    comment=Comment("; "),
    head=("G21 G90 G94 G40 G49 G80",),
    move="G53 G1 {axis}{to:.3f} F{feed:g}",
    end=("M2",),
    source="NISTIR 6556, RS274/NGC 3.5.12 (G53 with G0 or G1, in each block)",
)
