"""Lines that `compensate` prints and writes to the checklist."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap

from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Axis, Setup
from identification.compensation.advice import Advice, Scale
from identification.compensation.assessment import OTHER_TOOLS, Error, Figures
from identification.compensation.conditions import REPORTED_SHARE
from identification.compensation.result import Compensation, Stated
from identification.results.terminal import counted, one_line

TEXT_WIDTH = 110  # characters of a line
UNCHANGED_SHARE = 1e-3  # of the RMS error: smaller changes count as none; by judgement
COMMON_FILES = ("checklist.txt", "compensation.json")  # written for any controller
TRAVEL_END_SHARE = 0.02  # of the travel: a survey that ends closer to the end covers it; by judgement


def compensation_lines(result: Compensation, folder: Path) -> Iterator[str]:
    """All lines of the report for the operator, in order."""
    controller, setup = result.controller, result.setup
    yield f"{one_line(setup.machine)}: tables for {controller.title}"
    yield f"axes: {controller.legend(setup)}" + ("" if setup.numbers else " (others: --axes)")
    if setup.inverted:
        yield "sign: turned round (--invert)"
    if result.load is not None:
        yield f"load: {result.load:g} kg (another: --load)"
    for line in result.first:
        yield ""
        yield from wrap(line, TEXT_WIDTH)
    adjust: list[Advice | Scale] = sorted([*result.advice, *result.scales], key=lambda a: -a.effect_um)
    if adjust:
        yield ""
        where = f"; sizes at {result.adjusted_at}" if result.adjusted_at else ""
        yield from wrap(f"adjust before compensating (largest first{where}), then measure and fit again", TEXT_WIDTH)
        for n, a in enumerate(adjust, start=1):
            yield from wrap(f"{n}. {a.line()}", TEXT_WIDTH, initial_indent="  ", subsequent_indent="     ")
    if result.scaled_um is not None:
        said = f"with these scales set, and these tables: {result.scaled_um:.1f} um rms are left over the volume"
        instead = f" in place of {result.usual.figures[0].after.rms_um:.1f}"
        yield from wrap(f"{said}{instead}", TEXT_WIDTH, initial_indent="  ", subsequent_indent="     ")
    if result.outside:
        yield ""
        yield "not in these tables"
        for found in result.outside:
            yield from wrap(found.line(), TEXT_WIDTH, initial_indent="  ", subsequent_indent="    ")
    if result.reversals:
        yield ""
        yield "reversal errors of the model, and what becomes of them"
        for error in result.reversals:
            yield from wrap(error.line(), TEXT_WIDTH, initial_indent="  ", subsequent_indent="    ")
    if result.rotary and result.rotary.asked:
        yield ""
        yield "all figures: with the rotary axes described as they lie"
    for stated in result.sets:
        yield ""
        if stated.label:
            yield _state(stated)
        for figures in stated.figures:
            yield from figure_lines(figures, setup, isinstance(controller, Controller) and controller.follows_tool)
        yield from stated.notes
    for line in result.turned:
        if not line.startswith("FIRST"):
            yield from wrap(line, TEXT_WIDTH)
    if result.thermal:
        usual, files = result.usual, ", ".join(f for f in result.thermal.files if "/" not in f)
        yield ""
        yield f"in place of a folder for each temperature: that of {usual.label}, and {files}"
        for stated, figures in zip(result.sets, result.thermal.figures, strict=True):
            after, state = figures.after, _state(stated)
            yield f"  {f'left {state}':52} {after.rms_um:8.2f} {after.worst_um:8.2f}   um (rms, worst)"
        if result.thermal.doubt:
            yield f"  not certain: {result.thermal.doubt}"
            yield f"  follow {folder / 'sign_test' / 'temperature.txt'} first"
    if result.probing:
        (rms, worst), (rms_after, worst_after) = result.probing.before_um, result.probing.after_um
        yield ""
        yield "what a probe reads against the nozzle, over the bed"
        yield f"  {'before':52} {rms:8.2f} {worst:8.2f}   um (rms, worst)"
        yield f"  {'with ' + ', '.join(result.probing.files):52} {rms_after:8.2f} {worst_after:8.2f}"
    yield ""
    yield from wrap(f"region: what the survey covered; {result.edge}", TEXT_WIDTH)
    yield from (f"  {line}" for line in region_lines(setup))
    if isinstance(controller, Controller) and not controller.general:
        yield "lengths in the files are metric: load them into a control that is set to mm, not inches"
    if controller.doubt:
        yield ""
        yield from wrap(f"not certain from public sources: {controller.doubt}", TEXT_WIDTH, subsequent_indent="  ")
    yield ""
    yield "activation"
    for step in result.checklist:
        yield from wrap(step, TEXT_WIDTH, initial_indent="  [ ] ", subsequent_indent="      ")
    real = sum(len(s.files) for s in result.sets)
    more = [f for s in (result.thermal, result.probing) if s for f in s.files]
    check = len(result.tests) + sum(f.startswith("sign_test/") for f in more)
    real += sum(not f.startswith("sign_test/") for f in more)
    aside = f", {counted(check, 'file')} in sign_test" if check else ""
    yield ""
    yield f"{counted(real, 'file')} for the control{aside}, checklist.txt and compensation.json written to {folder}"


def _state(stated: Stated) -> str:
    return "at " + ", ".join(f"{k} = {v:.1f} {'s' if k == 'time' else 'degC'}" for k, v in stated.state.items())


def figure_lines(figures: Figures, setup: Setup, follows_tool: bool = False) -> Iterator[str]:
    """A table of one set of poses; `follows_tool`: whether the tables follow the length of the tool."""
    yield f"{figures.poses:54} {'rms':>8} {'worst':>8}   um"
    rows = (
        ("before", figures.before),
        ("after an ideal compensation", figures.ideal),
        ("after these tables", figures.after),
    )
    for what, error in rows:
        yield f"  {what:52} {error.rms_um:8.2f} {error.worst_um:8.2f}"
    if figures.in_state and figures.after.rms_um > (1 + REPORTED_SHARE) * figures.in_state.rms_um:
        error, what = figures.in_state, "the same, all in the state that the tables are for"
        yield f"  {what:52} {error.rms_um:8.2f} {error.worst_um:8.2f}"
    if figures.model_um is not None:
        yield f"  {'standard uncertainty of the model itself, beside that':52} {figures.model_um:8.2f}"
    better = figures.after.rms_um < figures.before.rms_um
    idle = abs(figures.after.rms_um - figures.before.rms_um) < UNCHANGED_SHARE * figures.before.rms_um
    share = f"{100 * figures.removed():.1f} % of what can be removed" if better else "WORSE THAN WITHOUT THEM"
    share = "tables of this format take nothing away here" if idle else share
    yield f"  worst then at {worst_place(figures.after, setup)}; {share}"
    if figures.poses.endswith(OTHER_TOOLS) and not follows_tool:
        tip = " ".join(f"{v:g}" for v in setup.tool)
        tail = ", and only do harm with those: switch them off, or make a set for each" if not better else ""
        yield f"  no table turns with a tool: these are for the tip at {tip} (--tool){tail}"


def worst_place(error: Error, setup: Setup) -> str:
    """The command of the worst pose."""
    return " ".join(f"{a.joint}={v:.1f}" for a, v in zip(setup.axes, error.where, strict=True))


def region_lines(setup: Setup) -> Iterator[str]:
    """The measured part of each travel."""
    for axis in setup.axes:
        unit = "deg" if axis.rotary else "mm"
        (a, b), (low, high) = axis.measured, axis.travel
        part = "" if _covers(axis) else f"  only part of the travel {low:g} to {high:g}"
        yield f"{axis.joint}: {a:.1f} to {b:.1f} {unit}{part}"


def _covers(axis: Axis) -> bool:
    (a, b), (low, high) = axis.measured, axis.travel
    return a - low <= TRAVEL_END_SHARE * (high - low) and high - b <= TRAVEL_END_SHARE * (high - low)
