"""A model that grows: the steps accepted so far, each a finding of its own or a refinement of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from identification.diagnosis.linear.linear_model import Workbench
from identification.diagnosis.search.scoring import Step


@dataclass(frozen=True)
class Growth:
    """The accepted steps, and the bench with all of them fitted."""

    start: Workbench
    bench: Workbench
    steps: tuple[Step, ...] = field(default=())

    @property
    def findings(self) -> list[list[Step]]:
        """Each finding with its refinements."""
        main = [k for k, s in enumerate(self.steps) if s.refines is None]
        return [[self.steps[k], *(s for s in self.steps if s.refines == k)] for k in main]

    def without(self, group: Sequence[Step]) -> Workbench:
        """The bench with all steps fitted but those of a group."""
        bench = self.start
        for step in self.steps:
            if step not in group:
                bench = bench.with_effect(step.effect)
        return bench


def replayed(start: Workbench, steps: Sequence[Step]) -> Growth:
    """A growth of these steps."""
    growth = Growth(start, start)
    for step in steps:
        growth = with_step(growth, step)
    return growth


def with_step(growth: Growth, step: Step) -> Growth:
    """With one more step, and its second cause where it has one."""
    alone = replace(step, partner=())
    out = Growth(growth.start, growth.bench.with_effect(step.effect), (*growth.steps, alone))
    number = len(growth.steps) if step.refines is None else step.refines
    for effect in step.partner:
        out = with_step(out, Step(effect, 0.0, 0.0, step.absorbed, refines=number))
    return out


def of_groups(start: Workbench, groups: Sequence[Sequence[Step]]) -> Growth:
    """A growth of findings, each with its refinements."""
    growth = Growth(start, start)
    for main, *more in groups:
        number = len(growth.steps)
        for step in (replace(main, refines=None), *(replace(s, refines=number) for s in more)):
            growth = with_step(growth, step)
    return growth
