"""Result of a compensation: tables and files for each state of a machine, residual errors, checklist."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from errormodel.controllers.base import EDGE_HOLDS, Controller, Target
from errormodel.controllers.probing import Probing
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables
from errormodel.controllers.turning import lathe_step
from identification.compensation.advice import Advice, Scale
from identification.compensation.assessment import Figures
from identification.compensation.by_position import Mean
from identification.compensation.conditions import (
    Conditions,
    backlash_lines,
    richer,
    shift_lines,
    together_line,
)
from identification.compensation.coordinates import Coordinates
from identification.compensation.findings import Outside, column_line
from identification.compensation.kinematic_description import Kinematics
from identification.compensation.model_uncertainty import against_model
from identification.compensation.reversal_effects import ReversalError
from identification.compensation.seams import Seam

SCHEMA = "errormodel.compensation/1"
# last step of the checklist
REDATUM_STEP = (
    "once the tables act, touch off work offsets, datum and tool setter again: positions that were taken without them "
    "are shifted by the corrections there"
)


@dataclass(frozen=True)
class Stated:
    """Files for one state of the machine (its temperatures), and their residual errors."""

    label: str  # subfolder of the output, "" if there is one state only
    state: Mapping[str, float]
    files: dict[str, str]
    tables: Tables
    figures: list[Figures]
    conditions: Conditions | None = None  # None for corrected commands, which need no zero shift or backlash value
    notes: tuple[str, ...] = ()  # remarks on rewritten programmes
    coordinates: Coordinates | None = None  # what it turns and shifts as a whole; None: not computed
    seams: tuple[Seam, ...] = ()  # steps of the correction where a rotary axis begins a new turn
    beyond: tuple[str, ...] = ()  # what comes first of commands that lie beyond what was measured

    @property
    def removed_um(self) -> float:
        """RMS error over the volume that tables take away; without bound of commands, which may not go that way."""
        if self.conditions is None:
            return math.inf
        return self.figures[0].before.rms_um - self.figures[0].after.rms_um


@dataclass(frozen=True)
class Own:
    """A controller's own temperature compensation in place of a set for each state, and its residual errors."""

    files: Mapping[str, str]
    figures: list[Figures]
    doubt: str


@dataclass(frozen=True)
class Compensation:
    """Everything that `compensate` writes and prints.

    Attributes
    ----------
    sets : tables and files, one entry per state of the machine, from cold to warm.
    tests : files of the check of signs and axes, by name.
    thermal : the controller's own temperature compensation; None: it has none.
    probing : correction of a probe's readings; None: not asked for.
    advice : mechanical adjustments to make first.
    rotary : constant errors of the rotary axes; None: there are none.
    columns : changes with which columns of the survey were taken; `unconfirmed`: they are those of a diagnosis.
    outside : findings of the diagnosis that the tables do not hold.
    reversals : reversal errors of the model, and what the tables hold of them.
    still : what comes first of rotary axes that the survey did not move.
    scales : scale errors that the tables do not hold, and where they are set.
    load : load that the tables are for, kg; None: the model depends on none.
    edge : what the correction is beyond the measured volume.
    means : recorded channels of which the mean by the position of a joint is followed.
    states : state of the machine that the tables are for, and residual errors in other states.
    adjusted_at : temperatures and time at which the sizes of `advice` and `scales` hold; empty: they change with none.
    """

    controller: Target
    setup: Setup
    sets: list[Stated]
    tests: dict[str, str]
    thermal: Own | None
    probing: Probing | None
    advice: list[Advice]
    notes: tuple[str, ...]
    states: tuple[str, ...] = ()
    rotary: Kinematics | None = None
    columns: tuple[str, ...] = ()
    unconfirmed: bool = False
    outside: tuple[Outside, ...] = ()
    reversals: tuple[ReversalError, ...] = ()
    still: tuple[str, ...] = ()
    scales: tuple[Scale, ...] = ()
    scaled_um: float | None = None
    load: float | None = None
    edge: str = EDGE_HOLDS
    means: Mapping[str, Mean] = field(default_factory=dict)
    adjusted_at: str = ""

    @property
    def usual(self) -> Stated:
        """The set for the middle state."""
        return self.sets[len(self.sets) // 2]

    @property
    def first(self) -> list[str]:
        """What comes before everything else: why not to load the tables, and zero shifts to make first."""
        stated = [s for s in self.sets if s.conditions is not None]
        other = self._more(self.controller) if isinstance(self.controller, Controller) else ""
        harm = in_words({s.label: w for s in self.sets if (w := against_model(s.figures))}, len(self.sets))
        no_use = {s.label: w for s in stated if s.conditions and (w := s.conditions.against(other))}
        harm = harm or in_words(no_use, len(self.sets))
        steps = sorted(((x, s.removed_um) for s in self.sets for x in s.seams), key=lambda step: step[0].step_um)
        worst = {x.joint: (x.line(removed), x.step_um > removed) for x, removed in steps}.values()
        harm += [line for line, harmful in worst if harmful]
        if self.rotary and harm:
            harm[-1] += self.rotary.apart
        changed = [column_line(self.columns)] if self.columns else []
        if self.unconfirmed:
            harm, changed = [*changed, *harm], []
        no = "DO NOT LOAD THESE TABLES" if isinstance(self.controller, Controller) else "DO NOT RUN WHAT WAS WRITTEN"
        against = [f"{no}: {why}" for why in harm]
        shifts = [
            line for s in stated if s.conditions for line in shift_lines(s.label, self.setup, s.tables, s.conditions)
        ]
        rotary = [self.rotary.first()] if self.rotary and (self.rotary.asked or self.rotary.worth) else []
        ordered = [*rotary, *shifts] if self.rotary and self.rotary.asked else [*shifts, *rotary]
        gentle = [line for line, harmful in worst if not harmful]
        if isinstance(self.controller, Controller):
            ordered += [f"FIRST: {x}" for x in self.controller.heed(self.usual.tables)]
        ordered += [x for x in self.turned if x.startswith("FIRST")]
        outside = dict.fromkeys(line for s in self.sets for line in s.beyond)
        ordered = ordered if harm else [*self._together, *ordered]
        return [
            *dict.fromkeys(against),
            *(f"FIRST: {line}" for line in changed),
            *outside,
            *gentle,
            *self.still,
            *ordered,
        ]

    @property
    def _together(self) -> list[str]:
        """What comes first of tables that do harm without the control's backlash parameters."""
        controller, words = self.controller, dict[str, str]()
        if not isinstance(controller, Controller):
            return []
        for s in self.sets:
            if s.conditions and (line := together_line(controller, self.setup, s.tables, s.conditions)):
                words[s.label] = line
        return [f"FIRST: {line}" for line in in_words(words, len(self.sets))]

    def _more(self, controller: Controller) -> str:
        """What can take away more than these tables: where rotary axes lie, before richer formats."""
        formats = f"--controller {' or '.join(richer(controller, self.setup))}"
        tables = self.usual.conditions.left_um if self.usual.conditions else 0.0
        if self.rotary and not self.rotary.asked and self.rotary.worth and self.rotary.left_um < tables:
            return f"--kinematics (it alone leaves {self.rotary.left_um:.1f} um{self.rotary.when}) or {formats}"
        return formats

    @property
    def turned(self) -> list[str]:
        """What the compensation turns and shifts as a whole, a line for every state with a step because of it."""
        tables = isinstance(self.controller, Controller)
        lines = {s.label: s.coordinates.line(tables) for s in self.sets if s.coordinates}
        steps = [f"{x}{f' ({label})' if label else ''}" for label, x in lines.items() if x.startswith("FIRST")]
        return steps or [x for label, x in lines.items() if label == self.usual.label]

    @property
    def checklist(self) -> list[str]:
        """Steps at the machine, in order; errors that the tables cannot represent come first."""
        usual, controller = self.usual, self.controller
        before = self.first
        if isinstance(controller, Controller) and usual.conditions:
            before += backlash_lines(controller, self.setup, usual.tables, usual.conditions)
            before += controller.about(usual.tables, self.setup)
        if isinstance(controller, Controller) and (step := lathe_step(self.setup)):
            before.append(step)
        after = [REDATUM_STEP] if isinstance(controller, Controller) else []
        after.append(f"to take it back: {controller.back}")
        needs = f"the control needs: {controller.needs}"
        before += [x for x in self.turned if x not in before]
        sign = ["check signs and axes before the real tables are loaded: sign_test/steps.txt"] if self.tests else []
        return [*before, *self.states, needs, *sign, *controller.checklist(self.setup), *after]

    def as_json(self) -> dict[str, Any]:
        """``compensation.json``."""
        return {
            "schema": SCHEMA,
            "controller": self.controller.name,
            "machine": self.setup.machine,
            "doubt": self.controller.doubt,
            "tool": list(self.setup.tool),
            "load": self.load,
            "followed_by_position": [mean.as_json(name) for name, mean in self.means.items()],
            "region": {a.joint: {"axis": a.name, "measured": a.measured, "travel": a.travel} for a in self.setup.axes},
            "corrects": list(self.setup.movers),
            "axes": {
                a.joint: {"axis": a.name, "address": self.controller.address(self.setup, a.name)}
                for a in self.setup.axes
            },
            "inverted": self.setup.inverted,
            "sets": [
                {
                    "folder": s.label,
                    "state": dict(s.state),
                    "files": list(s.files),
                    "notes": list(s.notes),
                    "tables": [_table_json(t) for t in s.tables],
                    "figures": [asdict(f) | {"removed": f.removed()} for f in s.figures],
                    "conditions": s.conditions.as_json() if s.conditions else None,
                    "coordinates": s.coordinates.as_json() if s.coordinates else None,
                    "steps": [asdict(x) for x in s.seams],
                }
                for s in self.sets
            ],
            "own_temperature_compensation": None
            if self.thermal is None
            else {
                "files": list(self.thermal.files),
                "doubt": self.thermal.doubt,
                "figures": [
                    {"state": dict(s.state)} | asdict(f) | {"removed": f.removed()}
                    for s, f in zip(self.sets, self.thermal.figures, strict=True)
                ],
            },
            "probe": None if self.probing is None else asdict(self.probing) | {"files": list(self.probing.files)},
            "scales": [asdict(a) for a in self.scales],
            "scaled_um": self.scaled_um,
            "advice": [asdict(a) for a in self.advice],
            "first": self.first,
            "not_in_tables": [
                asdict(o) for o in (*self.outside, *(r.outside for r in self.reversals if r.held != "all"))
            ],
            "reversals": [asdict(r) for r in self.reversals],
            "rotary_axes": None if self.rotary is None else self.rotary.as_json(),
            "checklist": self.checklist,
            "notes": list(self.notes),
        }


def in_words(reasons: Mapping[str, str], states: int) -> list[str]:
    """Reasons, by label, against the sets of some `states` of a machine, as one: that of the middle one of them."""
    labels = list(reasons)
    if not labels or states == 1:
        return [*reasons.values()]
    middle = labels[len(labels) // 2]
    which = f"in all {states} states" if len(labels) == states else f"in {' and '.join(labels)}"
    figures = f" (figures of {middle})" if len(labels) > 1 else ""
    return [f"{which}{figures}: {reasons[middle]}"]


def _table_json(table: Table) -> dict[str, Any]:
    t = table.term
    return {
        "output": t.output,
        "inputs": list(t.inputs),
        "points": list(t.shape),
        "factor": t.factor,
        "direction": t.direction,
    }
