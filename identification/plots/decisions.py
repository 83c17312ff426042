"""Candidates of a diagnosis by where they dropped out: the gain in log likelihood of each, round by round."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identification.diagnosis.decisions.constants import LEAST_EVIDENCE
from identification.diagnosis.decisions.fates import (
    ALTERNATIVE,
    BEHIND,
    CONTRADICTED,
    EXPLAINED,
    FOUND,
    LOW,
    MERGED,
    NEVER,
    PERHAPS,
    REFUSED,
    TAKEN_OUT,
    Fate,
    History,
    Place,
)
from identification.diagnosis.decisions.log import Decision
from identification.plots import style

ROW_IN, LABEL_IN, REASON_IN = 0.19, 2.2, 3.0  # inches: height of a row, widths of the texts beside the panel
MOST_ROUNDS = 4  # in the legend; of more the first and the last
LEAST_GAIN = 0.1  # gains below it are drawn there
GROUPS = {  # what became of candidates, in the order of the stages, and how many are shown
    FOUND: ("found", 12),
    MERGED: ("part of a finding", 5),
    ALTERNATIVE: ("another explanation of a finding", 8),
    CONTRADICTED: ("contradicted by a witness", 4),
    TAKEN_OUT: ("accepted, then taken out again", 4),
    PERHAPS: ("not found, and perhaps there", 4),
    REFUSED: ("refused by a test", 5),
    BEHIND: ("behind one that was refused", 5),
    EXPLAINED: ("explained by what was found", 6),
    LOW: ("too little evidence from the first", 5),
    NEVER: ("cannot be seen in this survey", 5),
}
ROUND_COLOURS = (style.NOMINAL, style.FITTED)  # first and last round; between them a mixture


def draw_decisions(parts: Mapping[str, History], asked: Collection[Place] = ()) -> Figure:
    """One row a candidate, grouped by where it dropped out: its gain in log likelihood from round to round, and why.

    Parameters
    ----------
    parts : the history of each part; the one with the largest gain is drawn.
    asked : effects at places that are always shown, and set in bold.
    """
    part = max(parts, key=lambda p: max((d.gain or 0.0 for d in parts[p].first_scores.values()), default=0.0))
    history = parts[part]
    groups = _grouped(history, asked)
    rows = sum(1 + len(fates) + (hidden > 0) for _, fates, hidden in groups)
    tall, top, bottom = rows * ROW_IN, 0.4, 0.55
    wide = style.REPORT_WIDTH_IN - LABEL_IN - REASON_IN
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, tall + top + bottom), facecolor="white")
    axes = style.panel(figure, LABEL_IN, bottom, wide, tall)
    style.dress(axes, "gain in log likelihood")
    axes.set_xscale("log")
    gains = [d.gain for d in history.decisions if d.rule == "candidate-score" and d.gain]
    high = 2 * max([10.0, *gains, *(_first_gain(f) for _, fates, _ in groups for f in fates)])
    axes.set_xlim(LEAST_GAIN / 1.5, high)
    style.decades(axes.xaxis, LEAST_GAIN, high)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    row = 0
    for title, fates, hidden in groups:
        _beside(axes, row, f"{title}", "", weight="bold")
        row += 1
        for fate in fates:
            _draw_row(axes, row, fate, history, (fate.effect, fate.where) in asked)
            row += 1
        if hidden:
            _beside(axes, row, f"and {hidden} more", "", colour=style.MUTED)
            row += 1
    _legend(axes, history)
    return figure


def _grouped(history: History, asked: Collection[Place]) -> list[tuple[str, list[Fate], int]]:
    """Title, the candidates shown and how many are not, of each group that has any; those with most gain first."""
    places = dict.fromkeys([*history.findings, *history.first_scores, *history.of_place])
    by_word: dict[str, list[Fate]] = {}
    for place in places:
        fate = history.fate(*place)
        if fate.word in GROUPS:
            by_word.setdefault(fate.word, []).append(fate)
    out = []
    for word, (title, most) in GROUPS.items():
        every = sorted(by_word.get(word, []), key=lambda f: -_first_gain(f))
        shown = [f for k, f in enumerate(every) if k < most or (f.effect, f.where) in asked]
        if shown:
            out.append((title, shown, len(every) - len(shown)))
    return out


def _first_gain(fate: Fate) -> float:
    return fate.first.gain or 0.0 if fate.first is not None else 0.0


def _draw_row(axes: Axes, row: int, fate: Fate, history: History, bold: bool) -> None:
    """A candidate: its gain in each round in which it was scored, joined by a line, and the rule that decided."""
    scores = dict(_by_round(history.of_place.get((fate.effect, fate.where), [])))
    if fate.first is not None:
        scores.setdefault(0, fate.first.gain or 0.0)
    own = [d.round for d in history.added if d.place == fate.place and fate.word in (FOUND, MERGED)]
    rounds = sorted(r for r in scores if not own or r <= min(own))  # what is accepted has no further evidence
    gains = np.maximum([scores[r] for r in rounds], LEAST_GAIN)
    every = _rounds(history)
    if rounds:
        axes.plot(gains, np.full(len(gains), row), color=style.FAINT, lw=1.5, zorder=1)
        for r, gain in zip(rounds, gains, strict=True):
            axes.plot(gain, row, "o", ms=5.5, color=_colour(every.index(r), len(every)), zorder=2 + r)
    weight = "bold" if bold or fate.word == FOUND else "normal"
    _beside(axes, row, f"  {style.plain(fate.place, 34)}", _reason(fate, history), weight=weight)


def _by_round(own: list[Decision]) -> Iterator[tuple[int, float]]:
    """The largest gain of each round."""
    for round_ in sorted({d.round for d in own if d.rule == "candidate-score"}):
        yield round_, max(d.gain or 0.0 for d in own if d.rule == "candidate-score" and d.round == round_)


def _reason(fate: Fate, history: History) -> str:
    """The rule that decided, with its value and threshold, or what explains the candidate."""
    if fate.word == EXPLAINED and fate.explained_by:
        return style.plain(f"by {', '.join(fate.explained_by)}", 46)
    if fate.word == ALTERNATIVE and (behind := history.behind(fate)):
        _, finding, difference = behind[-1]
        word = "behind" if difference >= 0 else "ahead of"
        return style.plain(f"log Bayes factor {abs(difference):.3g} {word} {finding}", 46)
    if fate.word == BEHIND and fate.last is not None:
        return f"log Bayes factor {fate.last.value:.3g} to the last"
    if fate.word == LOW and fate.first is not None:
        return f"log Bayes factor {fate.first.value:.3g} < {LEAST_EVIDENCE:.3g}"
    rules = [d for d in fate.deciding if d.rule != "candidate-score"]
    if fate.word == FOUND:
        tests = {d.rule: d for d in rules if d.rule in ("detection-in-correlated-noise", "cross-validation")}
        begun = "a repeated search begins with it" if any(d.rule == "search-from" for d in rules) else ""
        return style.plain(", ".join(map(_test, tests.values())) or begun, 52)
    if not rules:
        return ""
    d = rules[-1]
    return _test(d) if d.value is not None else style.plain(d.compared_with or d.rule, 52)


def _test(d: Decision) -> str:
    """A rule with its value and threshold."""
    if d.value is None or d.threshold is None:
        return d.rule
    sign = "<" if d.value < d.threshold else ">"
    return f"{d.rule.removesuffix('-in-correlated-noise')} {d.value:.3g} {sign} {d.threshold:.3g}"


def _rounds(history: History) -> list[int]:
    """The rounds in which candidates were scored."""
    return sorted({0, *(d.round for d in history.decisions if d.rule == "candidate-score")})


def _colour(place: int, count: int) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    share = place / max(count - 1, 1)
    one, other = (np.array(to_rgb(c)) for c in ROUND_COLOURS)
    return tuple((1 - share) * one + share * other)


def _beside(axes: Axes, row: int, left: str, right: str, weight: str = "normal", colour: str = style.INK) -> None:
    where = axes.get_yaxis_transform()
    # a little outside the panel, in shares of its width
    axes.text(
        -0.02, row, left, transform=where, ha="right", va="center", size=style.SMALL_TEXT, color=colour, weight=weight
    )
    axes.text(1.02, row, right, transform=where, ha="left", va="center", size=style.SMALL_TEXT, color=style.MUTED)


def _legend(axes: Axes, history: History) -> None:
    """A mark for each round, with what had been accepted before it."""
    rounds = _rounds(history)
    for k, r in enumerate(rounds):
        before = [d.place for d in history.added if d.round < r]
        words = f"and {style.plain(before[-1], 24)}" if before else "beside the geometry"
        if len(rounds) > MOST_ROUNDS and k == len(rounds) - 1:
            words = "beside all that was accepted"
        if len(rounds) <= MOST_ROUNDS or k in (0, len(rounds) - 1):
            axes.plot([], [], "o", ms=5.5, color=_colour(k, len(rounds)), label=words)
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.5, 1.0),
        ncols=4,
        frameon=False,
        fontsize=style.SMALL_TEXT,
        handletextpad=0.2,
        columnspacing=1.2,
    )
