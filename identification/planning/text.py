"""Text of a plan for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from identification.planning.plan import Change, Plan, Uncertainty
from identification.planning.power import Verdict
from identification.results.parameter_table import printed

VERDICT_ORDER = ("invisible", "confusable", "detectable")  # from worst to best


def plan_lines(plan: Plan) -> Iterator[str]:
    """Lines on rank and uncertainty, then on detectable, indistinguishable and invisible effects with their needs."""
    n = len(plan.table)
    yield plan.chain.machine.name
    set_up = any(name.startswith("observation[") for name in plan.groups.ids)
    what = "what is unknown of the set-ups" if set_up else "the measuring frame"
    yield (
        f"{n} rows, {len(plan.chain.machine_ids)} parameters; with {what} rank {plan.groups.rank}, "
        f"condition {plan.groups.condition:.3g}"
    )
    if plan.repeated:
        yield f"the last {plan.repeated} rows repeat the first, so that drift shows"
    yield f"\npredicted in the volume, um (k = 1){'worst':>10}{'median':>9}"
    rows: list[tuple[str, Uncertainty]] = [
        (f"planned, {n} rows", plan.uncertainty),
        (f"random, {n} rows", plan.random),
        (f"random, {2 * n} rows", plan.twice),
    ]
    for name, u in rows:
        yield f"  {name:34}{u.worst_um:9.3g}{u.median_um:9.3g}"
    yield f"D-efficiency {plan.d_efficiency:.2f} at least; {plan.d_random:.1f} times the information of random rows"
    if plan.blind:
        yield f"in {100 * plan.blind:.0f} % of the volume errors count that no allowed pose shows: not in the above"
    yield f"\n{'effects, at how many places':28}{'detected':>9}{'confused':>9}{'unseen':>7}   from, of what is possible"
    by_name: dict[str, list[Verdict]] = {}
    for verdict in plan.found:
        by_name.setdefault(verdict.effect, []).append(verdict)
    for name, own in by_name.items():
        counts = [sum(v.verdict == word for v in own) for word in reversed(VERDICT_ORDER)]
        yield f"  {name:26}{counts[0]:9d}{counts[1]:9d}{counts[2]:7d}   {_smallest(own)}"
    yield from _confused(by_name)
    yield from _unseen(by_name)
    for by in dict.fromkeys(c.by for c in plan.changes):
        yield from _changed(by, [c for c in plan.changes if c.by == by])


def _smallest(own: Sequence[Verdict]) -> str:
    """The smallest detectable size of an effect over all its places."""
    return _least([(v.smallest, v) for v in own if v.verdict != "invisible"])


def _least(sizes: Sequence[tuple[float | None, Verdict]]) -> str:
    """Text of the smallest size relative to the largest plausible one; empty where there is none."""
    known = [(size, v) for size, v in sizes if size is not None]
    if not known:
        return ""
    size, best = min(known, key=lambda pair: pair[0] / (pair[1].possible or 1.0))
    factor, unit = printed(best.unit)
    return f"{factor * size:.3g} of {factor * (best.possible or 0.0):.3g} {unit.replace('µ', 'u')}"


def _confused(by_name: dict[str, list[Verdict]]) -> Iterator[str]:
    """Lines on effects that are indistinguishable from effects of another name at all places, and their needs."""
    lines = []
    for name, own in by_name.items():
        others = [n.split(" at ")[0] for v in own for n in v.alike]
        names = [n for n in sorted(dict.fromkeys(others), key=lambda n: (-others.count(n), n)) if n != name]
        if names and not any(v.verdict == "detectable" for v in own):
            needs = next(v.needs for v in own if v.alike)
            apart = _least([(v.apart, v) for v in own if v.alike])
            hint = f" (distinguishable by form alone from {apart} on)" if apart else ""
            lines.append(f"  {name}: {', '.join(names[:3])}{hint}. Needs: {needs}")
    if lines:
        yield "\nseen, but not distinguishable from others at any place"
        yield from lines


def _unseen(by_name: dict[str, list[Verdict]]) -> Iterator[str]:
    """Lines on effects that are invisible at all places."""
    lines = [
        f"  {name}: {own[0].reason}. Needs: {own[0].needs}"
        for name, own in by_name.items()
        if all(v.verdict == "invisible" for v in own)
    ]
    if lines:
        yield "\nnever seen"
        yield from lines


def _changed(by: str, changes: Sequence[Change]) -> Iterator[str]:
    """Lines on effects whose verdict improves and worsens, with the number of places."""
    yield f"\nwith {by}"
    for word, sign in (("gained", 1), ("lost", -1)):
        moved = [c for c in changes if sign * (VERDICT_ORDER.index(c.after) - VERDICT_ORDER.index(c.before)) > 0]
        counts = {name: [c.effect for c in moved].count(name) for name in dict.fromkeys(c.effect for c in moved)}
        if counts:
            names = ", ".join(f"{name} ({n})" if n > 1 else name for name, n in counts.items())
            yield f"  {word}: {names}"
