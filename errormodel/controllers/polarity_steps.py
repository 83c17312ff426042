"""Instructions and programmes of the polarity check: positions, approach, and the meaning of each reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from errormodel.controllers.base import Controller
from errormodel.controllers.dialect import Dialect, Move
from errormodel.controllers.polarity import LEAST_READING_MM, TRAVEL_MARGIN_MM, Step, polarity_check
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from errormodel.controllers.text import printable
from errormodel.controllers.turning import DIAMETERS, LATHE_READINGS, OPTION, RADII, x_counts

FEWEST_INTERVALS = 8  # intervals of a table of the check, so that a peak fits
BACK_OFF_MM = 10.0  # mm between the start of an approach and its place; by judgement
SPINDLE_COSINE = 0.7  # cosine, from which an axis counts as running along the spindle; by judgement
STOP_SHORT_MM = 2.0  # mm before its place where a programme stops; the rest is jogged by hand
AWAY_FEED, TOWARDS_FEED = 500.0, 100.0  # mm/min, away from the indicator and towards it; by judgement
START_DISTANCE_MM = 20.0  # mm, within which a programme may be started; by judgement
FIRST_PROGRAMME_NUMBER = 7001  # number of the first programme, on controls that number programmes


def check_of(controller: Controller, setup: Setup, tables: Tables) -> dict[str, str]:
    """Files of the check of a controller's tables, by name; empty if no check is needed."""
    own = controller.own_check(setup, tables)
    if own is not None:
        return own
    axes = tuple(replace(a, intervals=max(a.intervals, FEWEST_INTERVALS)) for a in setup.axes)
    fine = replace(setup, axes=axes, points=None)  # tables of two points have no room for a peak
    files, steps = polarity_check(controller, fine, controller.structures(fine)[0])
    return {**files, **check_files(controller, fine, steps, list(files))} if steps else {}


def approach(setup: Setup, step: Step) -> float | None:
    """Start position (mm) of the axis to be read, `BACK_OFF_MM` before its place; None: no room.

    The side is one on which an indicator can stand; every position keeps `TRAVEL_MARGIN_MM` from the ends of travel.
    """
    for axis in setup.axes:
        low, high = axis.travel
        if (
            not axis.rotary
            and axis.name in setup.watched
            and not low + TRAVEL_MARGIN_MM <= step.place[axis.name] <= high - TRAVEL_MARGIN_MM
        ):
            return None
    low, high = setup.axis(step.axis).travel
    for side in _free_sides(setup, step.axis):
        start = step.place[step.axis] + side * BACK_OFF_MM
        if low + TRAVEL_MARGIN_MM <= start <= high - TRAVEL_MARGIN_MM:
            return start
    return None


def _free_sides(setup: Setup, name: str) -> tuple[float, ...]:
    """Sides from which an axis can approach an indicator, -1 or +1: along the spindle only that away from the table.

    The spindle nose points in the direction of the tool; without a tool plus Z leads away from the workpiece (ISO 841).
    """
    tool, along = np.asarray(setup.tool, np.float64), np.asarray(setup.axis(name).along)
    length = float(np.linalg.norm(tool))
    facing = float(tool @ along) / length if length > 1.0 else 0.0
    if abs(facing) > SPINDLE_COSINE:
        return (-1.0,) if facing > 0 else (1.0,)
    return (1.0,) if length <= 1.0 and name in ("Z", "W") else (-1.0, 1.0)


def moves_of(setup: Setup, step: Step, start: float) -> list[Move]:
    """Away along the watched axis, the others one by one, then towards the place, and a stop before it."""
    end, side = step.place[step.axis], 1.0 if start > step.place[step.axis] else -1.0
    others = [m for m in setup.watched if m != step.axis]
    return [
        Move(step.axis, start, AWAY_FEED, "retreat, away from the indicator"),
        *(Move(m, step.place[m], AWAY_FEED, "beside the place") for m in others),
        Move(
            step.axis, end + side * STOP_SHORT_MM, TOWARDS_FEED, f"approach, ends {STOP_SHORT_MM:g} mm before the place"
        ),
    ]


def check_files(
    controller: Controller, setup: Setup, steps: Sequence[Step], load: Sequence[str] = ()
) -> dict[str, str]:
    """``steps.txt``, and a programme for each reading where the control's language is known; `load`: the tables."""
    dialect, files = _dialect(controller, setup), dict[str, str]()
    lines = [*_opening(controller, setup, steps, load)]
    numbers = {m: controller.number(setup, m) for m in setup.watched} if controller.first_number is not None else {}
    for k, step in enumerate(steps, start=1):
        start = approach(setup, step)
        lines += ["", *_reading(controller, setup, k, step, start)]
        if dialect is None or start is None:
            continue
        name = f"check_{k}_{step.axis}"
        lines.append(f"   programme: {name}{dialect.suffix}")
        said = [
            f"polarity check {k}: {step.axis}, made for machine {printable(setup.machine)[:60]}",
            f"start only with {step.axis} on the {_side(start > step.place[step.axis])} side of {start:.3f}, "
            f"all within {START_DISTANCE_MM:g} mm of {_place(step.place, setup.watched)}, "
            "nothing in the way, feed override down",
            "see steps.txt for what to read and what it means",
        ]
        files[name + dialect.suffix] = dialect.programme(
            name, FIRST_PROGRAMME_NUMBER + k - 1, said, moves_of(setup, step, start), numbers
        )
    return {"steps.txt": "\n".join(lines) + "\n", **files}


def _dialect(controller: Controller, setup: Setup) -> Dialect | None:
    """Language of the programmes, with the word that makes X count radii where it counts diameters; None: none."""
    dialect, counts = controller.dialect, x_counts(setup)
    if dialect is None or counts == RADII:
        return dialect
    radii = counts == DIAMETERS and dialect.radii
    return replace(dialect, head=(*dialect.head, dialect.radii)) if radii else None


def _no_programme(counts: str) -> str:
    if counts == DIAMETERS:
        return "No programme is given: no word of this control for an X in radii was found in a public source."
    return f"No programme is given: whether X counts in diameters is a setting of the control ({OPTION} says it)."


def _opening(controller: Controller, setup: Setup, steps: Sequence[Step], load: Sequence[str]) -> list[str]:
    """Instructions common to all readings."""
    watched = list(dict.fromkeys(s.axis for s in steps))
    unseen = [m for m in setup.watched if m not in watched]
    still = [a for a in setup.axes if a.name not in setup.watched]
    peak = max((abs(s.reading) for s in steps), default=0.0)
    alone = max((abs(s.by_itself) for s in steps if s.by_itself is not None), default=0.0)
    programmes, counts = _dialect(controller, setup) is not None, x_counts(setup)
    return [
        "POLARITY CHECK: do the tables act on the right axis, and the right way? Before the real tables are loaded.",
        f"machine: {printable(setup.machine)}",
        f"control: {controller.title}",
        f"axes: {controller.legend(setup)}",
        f"tables of the check: {', '.join(load)}",
        *(["sign: turned round (--invert)"] if setup.inverted else []),
        *([LATHE_READINGS] if counts != RADII else []),
        "",
        "All positions are machine coordinates, mm and deg. Nothing is driven in rapid. The table is empty, the",
        "spindle stands, a person holds the feed override. The tables of this folder move no axis by more than",
        f"{peak:.3f} mm where they act as they should. Axes that are watched: {', '.join(watched) or 'none'}.",
        *([f"If a table that only multiplies others acts by itself, it moves one by {alone:.3f} mm."] if alone else []),
        *([f"No table of this check moves {', '.join(unseen)} enough to be read."] if unseen else []),
        *(
            [f"Before all: {', '.join(f'{a.name} at {steps[0].place[a.name]:.3f}' for a in still)}, by hand."]
            if still and steps
            else []
        ),
        *(
            ["Tables over rotary axes have the sign of the others; they have no reading of their own here."]
            if any(a.rotary for a in still)
            else []
        ),
        "",
        "For each reading below:",
        " a. Compensation off. "
        + (
            "Bring the axes by hand near the place, on the side it names. Run the programme:"
            if programmes
            else _no_programme(counts)
            if counts != RADII
            else "No programme is given for this control: its language was not found in a public source, or"
        ),
        "    it goes back along the watched axis, then to the place, slowly, and ends 2 mm before it."
        if programmes
        else "    Drive by hand, slowly, in machine coordinates, to 2 mm before the place."
        if counts != RADII
        else "    it has none. Drive by hand, slowly, in machine coordinates, to 2 mm before the place.",
        " b. The last 2 mm by hand, in steps of 0.1 and then 0.001 mm, exactly to the place, never beyond it.",
        " c. Put the indicator, its stand on the table, against the spindle nose, ahead of the motion. Set it to zero.",
        f" d. By hand {BACK_OFF_MM:g} mm back, along the watched axis only.",
        " e. Load this folder's tables as checklist.txt has it for the real ones, compensation on. If the control has",
        "    to be started and referenced again, drive by hand, and around the indicator.",
        " f. As a. (but compensation on) and b. again, from the same side. Read.",
        " g. By hand back along the watched axis; then take the indicator away.",
        f"At the end take the tables of this folder out again: {controller.back}.",
    ]


def _reading(controller: Controller, setup: Setup, k: int, step: Step, start: float | None) -> list[str]:
    """Instructions for one reading, with the meaning of every outcome."""
    want, axis = step.reading, step.axis
    come = (
        f"from the {_side(start > step.place[axis])} side, from {axis} = {start:.3f}"
        if start is not None
        else f"by hand only: within {TRAVEL_MARGIN_MM:g} mm of the end of a travel, "
        f"or no {BACK_OFF_MM:g} mm of room along {axis}"
    )
    lines = [
        f"{k}. Watch {axis} ({step.table}) at {_place(step.place, setup.watched)}, coming {come}",
        f"   {want:+.3f} mm ({axis} further towards {_side(want > 0)}): right.",
        f"   {-want:+.3f} mm: the control wants the other sign. Do not load the real tables: "
        f"{_cure(controller, setup)}.",
        "   0.000 mm: the compensation is not active, or acts on another axis.",
    ]
    if step.by_itself is not None and abs(step.by_itself) >= LEAST_READING_MM:
        lines.append(
            f"   {want + step.by_itself:+.3f} or {-want - step.by_itself:+.3f} mm: a table that only multiplies others "
            "acts by itself. Switch everything off and do not load the real tables."
        )
    lines.append("   anything else: axes are interchanged, or the step of the control is another. Do not load.")
    return lines


OTHER_SIGN_CAUSE = (
    "the sign is public for this control, so look for a direction of motion that was turned round in its settings"
)


def _cure(controller: Controller, setup: Setup) -> str:
    """Instruction for the other sign; tables that were already reversed are written again without --invert."""
    cure = controller.other_sign or OTHER_SIGN_CAUSE
    return cure.replace("with --invert", "without --invert") if setup.inverted else cure


def _place(place: Mapping[str, float], axes: Sequence[str]) -> str:
    return " ".join(f"{m}{place[m]:.3f}" for m in axes)


def _side(plus: bool) -> str:
    return "plus" if plus else "minus"
