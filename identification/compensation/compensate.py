"""Compensation of a fitted machine: tables, files, their reading back, emulation of the controller, residual errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import root
from errormodel.controllers import instead
from errormodel.controllers import target as target_of
from errormodel.controllers.base import Controller, Rewriter, Target, read_back, written
from errormodel.controllers.polarity_steps import check_of
from errormodel.controllers.probing import Probing
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import LONGER, Table, Tables, Term
from errormodel.exceptions import InputError
from errormodel.gcode.reading import Reading
from errormodel.machine import Vector
from identification.compensation.advice import mechanical_advice, scale_advice, with_scales
from identification.compensation.assessment import Correct, assess, emulated, left
from identification.compensation.beyond import carried_on, is_rows, passes, region_words, rows_beyond
from identification.compensation.conditions import (
    check_errors,
    check_size,
    conditions_of,
    held_at,
    state_lines,
)
from identification.compensation.coordinates import Coordinates
from identification.compensation.designs import Designs
from identification.compensation.field import Field, other_states
from identification.compensation.findings import changed_columns, findings_of, outside
from identification.compensation.late_temperatures import late_lines
from identification.compensation.model_uncertainty import against_model, following, judged
from identification.compensation.notes import first_lines, survey_notes
from identification.compensation.options import check_invert, check_most, source_of, stated_x, with_load
from identification.compensation.read_motions import known_at_tip, motion_rows, several_zeros
from identification.compensation.reduction import aligned, leftover, reduce
from identification.compensation.result import Compensation, Own, Stated
from identification.compensation.reversal import reversals
from identification.compensation.reversal_effects import reversal_errors
from identification.compensation.rotary_axes import described, rotary_axes
from identification.compensation.rows import Rows, held_out, joints_read, read_rows, taken_up
from identification.compensation.seams import seams
from identification.compensation.volume import Volume, levels
from identification.observation.frames import rotation_notes
from identification.results import store
from identification.results.stored_fit import StoredFit
from identification.runtime.progress import Progress, silent

SAMPLE_POSES = 3000  # poses of the reduction, times the ratio of TABLES_PER_SAMPLE to the number of tables
EXACT_LATTICE_VALUES = 1600  # values of a lattice over all axes: larger ones take the exact corrections at the nodes
TABLES_PER_SAMPLE, MOST_SAMPLES = 30, 8  # that ratio is at most MOST_SAMPLES: few tables are cheap; by judgement
SUFFICIENT_SHARE = 0.03  # of the largest error: a structure that leaves less is accepted at once; by judgement
RICHER_SHARE = 0.9  # of the plainer structure's largest error: a richer one must leave less; by judgement


def compensate(
    folder: Path,
    name: str,
    points: int | None = None,
    resolution: float | None = None,
    program: Path | None = None,
    probe: tuple[float, float] | None = None,
    tool: Vector | None = None,
    seed: int = 0,
    progress: Progress = silent,
    reading: Reading | None = None,
    *,
    axes: str | None = None,
    invert: bool = False,
    allow_large: bool = False,
    kinematics: bool = False,
    keep_alignment: bool = False,
    max_tables: int | None = None,
    load: float | None = None,
    x_counts: str | None = None,
) -> Compensation:
    """Compute the tables of a controller for the machine that was fitted into `folder`.

    Parameters
    ----------
    folder : output folder of a fit.
    name : word of the controller, such as ``siemens-lec``.
    points : points an axis; None: as many as the errors need.
    resolution : least increment of the controller, mm; None: the usual one of the format.
    program : for a target without tables, the programme to rewrite; `reading` : how it is read.
    probe : x and y of a probe from the nozzle, mm, whose readings the controller corrects, too.
    tool : tip of the tool that the tables are for, mm in the last frame; None: that of ``machine.yaml``.
    axes : letters and numbers of the joints on the controller, ``X=1,Y=2``; None: the usual ones.
    invert : whether the files get the other sign, because the check showed that the control wants it.
    allow_large : whether corrections beyond 1 mm are written.
    kinematics : whether the controller's kinematic description takes the constant errors of rotary axes, and the tables
        what remains.
    keep_alignment : whether fixtures, bed and probes are not aligned again once the tables act.
    max_tables : tables that are used at most, where the control holds few: those that gain most.
    load : load that the tables are for, kg; None: the median of the survey's rows.
    x_counts : how the control counts X, ``radii`` or ``diameters``; None: as the machine shows, if it does.

    Raises
    ------
    InputError
        The folder holds no fit, there is no such controller, or the format cannot hold this machine's corrections.
    """
    controller = target_of(name)
    check_invert(controller, invert)
    check_most(controller, max_tables)
    source = source_of(controller, program, reading)
    with progress("Reading"):
        fit = store.load(folder)
        table = read_rows(folder, fit.chain.machine)
        read = joints_read(table)
        held = held_out(fit, table)
        if tool is not None:
            fit = replace(fit, chain=Chain(replace(fit.chain.machine, tool=tool)))
        field, of_load = with_load(Field.of(fit, table).following(table), load, table)
        if read is not None:
            field = field.of_joints(known_at_tip(folder, read))
            held = motion_rows(field, table, read)
    volume = Volume.of(field, table, fit.frame_mode != "fixed", turns=read is None)
    volume = carried_on(volume) if isinstance(controller, Rewriter) else volume
    channels = [root(c) for c in field.chain.channels]
    states = levels(table, channels)
    middle = states[len(states) // 2]
    if volume.free and read is not None:
        volume = volume.counted_from(middle, every=several_zeros(fit.values, read))
    with progress("Following the errors along each axis"):
        setup, notes = volume.planned.setup(points, resolution, axes)
    loose = [c for c in field.conditions if c not in states[0]]
    rotary = None
    if read is None:
        fixed = [c for c in loose if c not in field.means]
        state = {**middle, **{c: field.state[c] for c in fixed}}
        beside = other_states(field, table, states, fixed)
        rotary = rotary_axes(controller, volume.at(middle), setup, seed, kinematics, fit, allow_large, state, beside)
    plain = volume
    if rotary is not None and kinematics:
        field = described(field, setup, rotary.lines)
        volume = replace(volume, field=field)
        setup = volume.planned.setup(points, resolution, axes)[0]
    letters = {a.joint: a.name for a in setup.axes}
    by_axis = None if read is None else {a.name: read.get(a.joint, ()) for a in setup.axes}
    setup = replace(
        setup, probe=probe, inverted=invert, reversals=reversals(field, letters), read=by_axis,
        aligned=keep_alignment, most_tables=max_tables, x_stated=stated_x(x_counts, setup),
    )  # fmt: skip
    controller.suits(setup)
    whole = fit if read is None else None
    setup, of_tools = following(whole, volume, setup, controller, seed)
    probing = _probing(controller, setup, volume.planned) if probe else None
    if len(states) > 1 and volume.free:
        volume = replace(volume, pose=volume.at(middle).frame)
    sets, designs = [], Designs(len(states))
    for state in states:
        here = volume.at(state)
        label = re.sub(r"[^\w.-]", "_", "_".join(f"{k}_{v:.1f}" for k, v in state.items()), flags=re.ASCII)
        what = f"{controller.title}{f', {label}' if label else ''}"
        near = held and held.nearest(state, states)
        if isinstance(controller, Controller):
            sets.append(
                _one_state(
                    controller, setup, here, whole, near, label, state, seed, allow_large, what, designs, progress
                )
            )
        elif isinstance(controller, Rewriter):
            with progress(f"Commands for {what}"):
                sets.append(_rewritten(controller, setup, here, fit, near, label, state, source, reading, seed))
    tests: dict[str, str] = {}
    own = None
    if isinstance(controller, Controller) and len(sets) > 1 and "time" not in states[0]:
        own = _own_thermal(controller, setup, volume, sets, seed)
    if isinstance(controller, Controller) and sets[0].tables:
        tests = check_of(controller, setup, sets[0].tables)
    usual = sets[len(sets) // 2]
    follows = is_rows(source[0]) and not isinstance(controller, Controller)
    correct: Correct = (volume if follows else volume.planned).ideal
    if isinstance(controller, Controller):
        correct = emulated(controller, usual.tables, setup, volume)
    here = volume.at(usual.state)
    said = state_lines(here, table, loose, correct, seed)
    if rotary is not None and kinematics and isinstance(controller, Controller):
        plain = plain.at(usual.state)
        bare = left(plain, emulated(controller, usual.tables, setup, plain), seed).rms_um
        rotary = replace(rotary, tables_alone_um=bare)
    found = findings_of(folder)
    columns, unconfirmed = changed_columns(found, field)
    scales = scale_advice(here, setup, controller, fit) if read is None else []
    scaled_um = None
    if scales and isinstance(controller, Controller) and not controller.general:
        of = emulated(controller, usual.tables, setup, volume)
        scaled_um = left(here, with_scales(of, scales, here), seed).rms_um
    advice = mechanical_advice(here, usual.figures[0].before.rms_um, fit)
    return Compensation(
        controller,
        setup,
        sets,
        tests,
        own,
        probing,
        advice,
        (
            *fit.unlisted,
            *of_load,
            *notes,
            *rotation_notes(fit.frames),
            *survey_notes(volume, setup, held is not None, read),
        ),
        (*of_tools, *said, *late_lines(field, own is not None, table, states)),
        rotary,
        tuple(columns),
        unconfirmed,
        tuple(outside(found, field, loose)),
        reversal_errors(here, correct, seed, controller, setup, usual.tables, found, loose, follows),
        first_lines(fit, setup, read, isinstance(controller, Controller)),
        tuple(scales),
        scaled_um,
        field.state["load"] if "load" in channels else None,
        controller.beyond if isinstance(controller, Controller) else region_words(volume),
        field.means,
        ", ".join(held_at(here.field, name) for name in here.field.conditions if name.startswith(("T_", "time"))),
    )


def _probing(controller: Target, setup: Setup, volume: Volume) -> Probing:
    if not isinstance(controller, Controller):
        raise InputError("--probe", f"{controller.title} corrects no readings", "Leave it out")
    return controller.probing(setup, volume.gap(setup))


def _one_state(
    controller: Controller,
    setup: Setup,
    volume: Volume,
    fit: StoredFit | None,
    held: Rows | None,
    label: str,
    state: Mapping[str, float],
    seed: int,
    allow_large: bool,
    what: str,
    designs: Designs,
    progress: Progress,
) -> Stated:
    with progress(f"Tables for {what}"):
        ideal = volume.ideal
        check_errors(
            volume, setup, allow_large, what, seed, lambda: against_model(judged(fit, volume, ideal, held, seed))
        )
        tables = best_tables(controller, setup, volume.planned, designs)
    if setup.read is not None and not any(
        np.abs(t.values).max(initial=0.0) > controller.quantum(setup) for t in tables
    ):
        joints = " and ".join(a.joint for a in setup.axes if setup.read.get(a.name))
        found = f"nothing of what was read of {joints} can be taken away by tables of this format"
        raise InputError(f"--controller {controller.name}", found, f"Use --controller {instead()}")
    with progress("Writing and reading them back"):
        files = written(controller, tables, setup)
        back = read_back(controller, files, setup)
    with progress("Judging what they leave"):
        correct = emulated(controller, back, setup, volume)
        figures = judged(fit, volume, correct, held, seed)
        steps = seams(volume, setup, correct, seed)
        conditions = conditions_of(controller, setup, volume, back, seed)
        turned = Coordinates.of(volume, correct, seed, setup.aligned)
        if turned.must_align and (still := aligned(controller, setup, tables, designs)):
            kept = Coordinates.of(volume, emulated(controller, still, setup, volume), seed)
            turned = replace(turned, kept_um=kept.unaligned_um)
        said = fewer_lines(controller, setup, volume, back, seed) if setup.most_tables is not None else ()
    check_size(conditions.largest, allow_large, what, against_model(figures))
    return Stated(label, state, files, back, figures, conditions, said, turned, steps)


def _own_thermal(controller: Controller, setup: Setup, volume: Volume, sets: list[Stated], seed: int) -> Own | None:
    """The controller's own temperature compensation, assessed in every state."""
    found = controller.thermal([(s.state, s.tables) for s in sets], setup)
    if found is None:
        return None
    tables, laws, figures = sets[len(sets) // 2].tables, found.laws, []
    for stated in sets:
        here = volume.at(stated.state)
        plain, state = emulated(controller, tables, setup, here), stated.state

        def correct(
            q: Array, came: Array, tool: Array | None, plain: Correct = plain, state: Mapping[str, float] = state
        ) -> Array:
            out = plain(q, came, tool)
            for law in laws:
                out[:, setup.place(law.axis)] += law.at(state, q[:, setup.place(law.axis)])
            return out

        figures += assess(here, correct, None, seed)
    return Own(found.files, figures, found.doubt)


def _rewritten(
    rewriter: Rewriter,
    setup: Setup,
    volume: Volume,
    fit: StoredFit,
    held: Rows | None,
    label: str,
    state: Mapping[str, float],
    source: tuple[str, str],
    reading: Reading | None,
    seed: int,
) -> Stated:
    import pandas as pd

    field, (name, text) = volume.field, source
    rows = is_rows(name)  # the path to each is known; of a programme it would have to be followed within each block
    ideal = (volume if rows else volume.planned).ideal

    def correct(q: Array, direction: Array) -> Array:
        inner = field.inward(q)
        if rows:
            path = pd.DataFrame(inner, columns=[j.name for j in field.joints])
            direction = np.hstack([direction, taken_up(field.chain, path)])
        return field.outward(ideal(inner, direction))

    conditions = {name: held_at(field, name) for name in field.conditions}
    done = rewriter.rewrite(name, text, replace(setup, conditions=conditions), correct, reading)
    step, movers = 2 * rewriter.quantum(setup), list(field.movers)

    def rounded(q: Array, direction: Array, tool: Array | None) -> Array:
        out = q.copy()
        moved = field.outward(ideal(q, direction, tool))[:, movers]
        out[:, movers] = np.round(moved / step) * step * np.where(field.rotary[movers], np.pi / 180, 1.0)
        return out

    # the line ends of the original programme are kept, since the control may require them
    new = re.sub(r"\r?\n", "\r\n", done.text) if "\r\n" in text else done.text
    commanded = field.inward(rewriter.positions(name, text, setup, reading))
    steps = seams(volume, setup, rounded, seed, passes(volume, commanded))
    figures = judged(fit if setup.read is None else None, volume, rounded, held, seed)
    turned, outside = Coordinates.of(volume, rounded, seed), tuple(rows_beyond(fit, volume, name, commanded))
    return Stated(label, state, {name: new}, (), figures, None, done.notes, turned, steps, outside)


def fewer_lines(controller: Controller, setup: Setup, volume: Volume, tables: Tables, seed: int) -> tuple[str, ...]:
    """What the bound on the number of tables costs: the residual error with as many as the format takes."""
    whole = replace(setup, most_tables=None)
    every = best_tables(controller, whole, volume.planned)
    used, all_of = (controller.used([t.term for t in x]) for x in (tables, every))
    few, most = (left(volume, emulated(controller, t, setup, volume), seed).rms_um for t in (tables, every))
    asked = f"{used} tables of the control, at most {setup.most_tables}"
    return (f"{asked}: {few:.1f} um rms are left; {most:.1f} with {all_of}",)


def best_tables(controller: Controller, setup: Setup, volume: Volume, designs: Designs | None = None) -> Tables:
    """Tables of the structure with the smallest largest error; for a fine lattice, the exact corrections at its nodes.

    Structures are tried from the plainest on; a richer one replaces it only if it is clearly better. The first of
    the states of a machine (`designs`) decides for all.
    """
    structures = controller.structures(setup)
    if volume.origin is not None and volume.reference_moved < controller.quantum(setup):
        structures = [[t for t in terms if t.inputs or t.factor] for terms in structures]  # no shift of the zero
    longer = [t for t in structures[-1] if t.factor == LONGER]
    if longer:  # both from the same nodes in the same frame, so that they hold together
        return volume.followed([t for t in structures[-1] if t.factor != LONGER], longer, setup)
    return _best_of(structures, controller, setup, volume, designs or Designs())


def _best_of(
    structures: list[list[Term]], controller: Controller, setup: Setup, volume: Volume, designs: Designs
) -> Tables:
    best: Tables = ()
    chosen = 0
    for rank, terms in enumerate(structures):
        if designs.rank not in (None, rank):
            continue
        if sum(t.size for t in terms) > EXACT_LATTICE_VALUES:
            values = volume.nodes(terms, setup)
            if values is not None:
                return tuple(Table(t, v) for t, v in zip(terms, values, strict=True))
        # few tables are cheap and need many poses, since errors that they cannot represent act as noise
        sample = volume.sample(
            setup, int(np.clip(TABLES_PER_SAMPLE / max(len(terms), 1), 1, MOST_SAMPLES)) * SAMPLE_POSES
        )
        tables = reduce(controller, setup, terms, sample, controller.most_tables, designs)
        left, before = (leftover(controller, setup, t, sample, designs) for t in (tables, ()))
        if not best or left < RICHER_SHARE * leftover(controller, setup, best, sample, designs):
            best, chosen = tables, rank
        if left < SUFFICIENT_SHARE * before:
            break
    designs.rank = chosen
    return best
