"""Predictions of a stored fit: measured positions, volumetric error, and standard uncertainties.

Positions and errors are in mm in the measuring frame, error motions in mm and rad, standard uncertainties with k = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, as_rows
from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, PLAUSIBLE_SIZES
from errormodel.effects.axis_blunder import mended_words
from errormodel.survey import Survey
from errormodel.surveys.columns import MOTION_UNCERTAINTIES
from identification.diagnosis.decisions.constants import MISFIT_RATIO
from identification.observation.assembly import frame_columns, frame_labels
from identification.observation.frames import rotation_notes
from identification.observation.pose import IDENTITY, Pose
from identification.results.stored_fit import StoredFit
from identification.uncertainty.estimated_targets import estimated_targets
from identification.uncertainty.measured_range import (
    beyond_notes,
    unrecorded_load,
    unrecorded_temperatures,
    unused_temperatures,
)
from identification.uncertainty.one_side import from_other_sides
from identification.uncertainty.other_effects import (
    OtherEffect,
    perhaps_ended,
    possible_causes,
    unrecorded,
    with_other_effects,
    without_times,
)
from identification.uncertainty.read_on_the_fly import on_the_fly, perhaps_at_rest
from identification.uncertainty.reading_prediction import predicted_readings, rigid_parts
from identification.uncertainty.recording_end import (
    after_gaps,
    after_last_row,
    as_in_last_run,
    continued,
    in_last_run,
    started_anew,
    with_runs,
)
from identification.uncertainty.rows_in_time import as_course, smoothed, timed, with_noise
from identification.uncertainty.unknown_rests import rested, with_other_use
from identification.uncertainty.unknown_sides import midway
from identification.uncertainty.unknown_temperatures import with_unknown_temperatures
from identification.uncertainty.unmeasured_components import unmeasured_notes
from identification.uncertainty.unseen_expansion import with_unseen_expansion

if TYPE_CHECKING:
    import pandas as pd

PREDICTION_BLOCK_ROWS = 8192  # rows whose M is held at a time: limits the memory

ERRORS = ("ex", "ey", "ez", "ux", "uy", "uz")
TURNED_DEG = 1.0  # deg: a measuring frame turned by less hardly changes what an error along an axis is; by judgement
TURNED = (
    "ex ey ez and ux uy uz are along the axes of the measuring frame, which is turned against the machine by {}{:.1f} "
    "deg: --axes machine gives them along x y z of machine.yaml"
)
FREE_REFERENCE = (
    "readings alone do not show where the machine stands: positions and errors are relative to the reference that its "
    "own errors fit best over the travels, and a shift or rotation of all of it is not in their uncertainty"
)
MISFIT = (
    "the residuals of the fit are {:.3g} times as large as the declared uncertainty: what its model lacks is in these "
    "predictions, and in their uncertainty only as if it were noise. `errormodel diagnose` looks for it"
)
LEFT = "the diagnosis left {:.2g} um of a coordinate {}. The uncertainty has it as it was in the recording: {}"
MUCH_LARGER = "later, warmer or elsewhere it may be much larger"
BEYOND = {  # what is known of it
    "repeats": ("beyond the scatter of repeated poses, which nothing explains", MUCH_LARGER),
    "recorded": ("that depends on what was recorded, all or in part, and that nothing explains", MUCH_LARGER),
    "declared": (
        "beyond the declared uncertainty, which nothing recorded predicts: each row may scatter so (a machine that "
        "does not repeat, an instrument worse than declared), or it has a cause that was not recorded. Repeated poses "
        "tell which",
        f"if it has a cause, {MUCH_LARGER}",
    ),
    None: ("beyond the noise, which nothing explains", MUCH_LARGER),
}
WORTH = 3  # identified parameters that `PLAUSIBLE_SIZES` count as; by judgement
MISTAKE = (
    "{text}: that mistake of the fitted survey is taken to be in these rows as well, and mended. If it is not, correct "
    "the survey, diagnose or fit it again, and predict from that"
)


def predict(fit: StoredFit, points: Survey) -> pd.DataFrame:
    """Predict measured positions and volumetric errors at commanded poses.

    Effects of the instrument (a moved station, drift, scale) are part of the measured position, not of the machine's
    error. The uncertainty contains the covariance of the estimated parameters and, for unidentified parameters that act
    here (with another tool, for instance), the size of the identified ones of the same unit; where the noise was
    estimated with few degrees of freedom it is widened, so that twice it covers 95.45 % (Student's t). Of a position
    and an error it contains what a diagnosis found left beyond the noise, too.

    Parameters
    ----------
    points : commands, mm and rad, with the model's channels.

    Returns
    -------
    DataFrame
        ``mx my mz`` (predicted measurement), ``ex ey ez`` (error, actual minus nominal) and ``ux uy uz`` (its standard
        uncertainty, k = 1), mm in the measuring frame. Rows about one joint (column ``joint``) get its error motions
        ``dx ... ec`` (mm, rad) relative to the joint's own zero, and their standard uncertainties ``u_dx ... u_ec``.
        With the machine's axes (`StoredFit.error_axes`) ``e`` and ``u`` are along x y z of ``machine.yaml``.
    """
    import pandas as pd

    if fit.error_axes == "machine":
        fit = replace(fit, error_axes="measured")
        unturned = {label: replace(pose, rotation=np.eye(3)) for label, pose in fit.frames.items()}
        return predict(fit, points).assign(**predict(replace(fit, frames=unturned), points)[[*ERRORS]])

    points = with_noise(points, fit.data.get("temperature_noise", {}))
    points = replace(points, table=timed(fit.chain.channels, points.table, at_rest=False))
    labels = _labels(fit, points)
    channels = _channels(fit, points)
    likeliest = _predict_rows(fit, channels, labels)

    def change(other: OtherEffect) -> Array:
        own = fit.with_effect(other)
        rows = replace(points, table=timed(own.chain.channels, points.table))
        return _predict_rows(own, _channels(own, rows), labels, _positions) - likeliest[:, :3]

    recorded = fit.data.get("temperatures", {})
    out = with_unknown_temperatures(
        fit.chain, recorded, points.table, channels, labels, likeliest, partial(_predict_rows, fit)
    )
    out = midway(fit.chain, points.table, channels, labels, out, partial(_predict_rows, fit))
    out = with_other_use(fit.chain, channels, labels, out, partial(_predict_rows, fit))
    out = perhaps_at_rest(fit.chain, points.table, channels, labels, out, partial(_predict_rows, fit))
    ranges, expansions = fit.data.get("covered", {}), fit.data.get("expansions") or {}
    out = with_unseen_expansion(
        fit.chain.machine, ranges, expansions, points.table, channels, labels, out, partial(_predict_rows, fit)
    )
    # at last: what is above compares predictions of the likeliest model with each other
    out = with_other_effects(fit.others_for(points.table), len(fit.chain.machine.effects), out, change)
    table = pd.DataFrame(out, columns=["mx", "my", "mz", "ex", "ey", "ez", "ux", "uy", "uz"], index=points.table.index)
    if "joint" in points.table:
        table[[*MOTIONS, *MOTION_UNCERTAINTIES]] = _motions(fit, points, channels)
    if points.observations:
        table = table.assign(**predicted_readings(fit, points, _variance))
    return table


def _channels(fit: StoredFit, points: Survey) -> list[Array]:
    """The model's channels at commands, which go on from the recording."""
    channels = continued(fit.chain, fit.data.get("temperatures", {}), points.table, fit.chain.columns(points.table))
    channels = in_last_run(fit.chain, fit.data.get("runs", ()), with_runs(points), channels)
    return after_last_row(fit.chain, channels)


def _predict_rows(
    fit: StoredFit,
    channels: list[Array],
    labels: Array,
    of_frame: Callable[[StoredFit, list[Array], str | None], Array] | None = None,
) -> Array:
    """Predictions (n, 9) of rows with the frame labels `labels`, or what else is predicted of those in a frame."""
    first, parts = next(iter(fit.frames), None), list[tuple[Index, Array]]()
    for label in dict.fromkeys(labels):
        used = label if label in fit.frames else first
        index = np.flatnonzero(labels == label)
        for part in np.array_split(index, len(index) // PREDICTION_BLOCK_ROWS + 1):
            parts.append((part, (of_frame or _predict_frame)(fit, as_rows(*(c[part] for c in channels)), used)))
    out = np.full((len(labels), parts[0][1].shape[1] if parts else 9), np.nan)
    for part, own in parts:
        out[part] = own
    return out


def _motions(fit: StoredFit, points: Survey, channels: list[Array]) -> Array:
    """Error motions and their standard uncertainties (n, 12) in rows about a joint; NaN in others."""
    chain, out = fit.chain, np.full((len(points), 12), np.nan)
    joint = points.table["joint"].to_numpy(dtype=object)
    for name in dict.fromkeys(joint[joint != ""]):
        index = np.flatnonzero(joint == name)
        ids = tuple(i for i in chain.machine_ids if chain.parameters[chain.index[i]].element == name)
        rows = as_rows(*(np.nan_to_num(c[index]) for c in channels))
        terms = chain.kernel("terms", ids)(rows, np.zeros(len(chain.ids))).reshape(-1, 6, len(index))[: len(ids)]
        values = np.array([fit.values.get(i, 0.0) for i in ids])
        out[index, :6] = np.einsum("p,pim->mi", values, terms)
        out[index, 6:] = np.sqrt(_variance(fit, [*ids], terms)).T
    return out


def _labels(fit: StoredFit, points: Survey) -> Array:
    """Frame label of each row, by the rule of the fitted survey: commands have no frame of their own."""
    return frame_labels(points, fit.frame_mode)


def notes(fit: StoredFit, points: Survey) -> tuple[str, ...]:
    """Notes on unchecked files, assumed rotations, rows in another run's frame, extrapolation, assumed directions."""
    machine, table, others = fit.chain.machine, points.table, fit.others_for(points.table)
    ranges = fit.data.get("covered", {})
    beyond = beyond_notes(fit.chain, ranges, table, possible_causes(others, machine))
    free = (FREE_REFERENCE,) if fit.free_reference else ()
    own = (*fit.unlisted, *_turned(fit), *rotation_notes(fit.frames), *fit.sign_notes)
    temperatures = fit.data.get("temperatures", {})
    late = (*started_anew(fit.chain, temperatures, points.table), *after_gaps(fit.chain, temperatures, points.table))
    ended = as_in_last_run(fit.chain, fit.data.get("runs", ()), with_runs(points))
    idle, moving = rested(fit.chain, points.table), on_the_fly(fit.chain, points.table)
    left = (LEFT.format(1e3 * fit.systematic, *BEYOND[fit.data.get("systematic_by")]),) if fit.systematic else ()
    misfit = (MISFIT.format(ratio),) if not left and (ratio := _misfit(fit)) ** 2 > MISFIT_RATIO else ()
    mistakes = (MISTAKE.format(text=text) for text in mended_words(machine))
    missing = {name for other in fit.others for name in other.missing(machine, table)}
    changes = (
        *smoothed(fit.chain.channels, points, fit.data.get("temperature_noise", {})),
        *as_course(fit.chain.channels, [other.channels(machine) for other in others], table),
        *late,
        *unrecorded_load(ranges, table),
        *unused_temperatures(ranges, table),
        *unrecorded_temperatures(ranges, table, missing),
        *estimated_targets(machine, table),
        *unrecorded(fit.others, machine, table),
        *without_times(others, machine, table),
        *perhaps_ended(fit.others, machine, table),
        *ended,
        *idle,
        *moving,
        *from_other_sides(fit.chain, fit.data.get("only_sides", {}), points),
    )
    unknown = unmeasured_notes(fit.data.get("unmeasured", {}), [*fit.frames], _labels(fit, points).tolist())
    frames = (*_unfitted(fit, points), *unknown, *free)
    return (*misfit, *left, *mistakes, *own, *frames, *beyond, *changes, *_arrivals(fit, points))


def _turned(fit: StoredFit) -> Iterator[str]:
    """A note where the errors' axes are far from those of the machine."""
    turns = [float(np.degrees(np.arccos(np.clip((np.trace(p.rotation) - 1) / 2, -1, 1)))) for p in fit.frames.values()]
    if fit.error_axes == "measured" and max(turns, default=0.0) > TURNED_DEG:
        yield TURNED.format("up to " if len(turns) > 1 else "", max(turns))


def _misfit(fit: StoredFit) -> float:
    """Times the declared uncertainty that the residuals of the fit are, where chi-squared rejects it; else 1."""
    return float(fit.data.get("inflation", 1.0)) if fit.data.get("sigma_from") == "declared" else 1.0


def _arrivals(fit: StoredFit, points: Survey) -> Iterator[str]:
    """Notes on joints whose approach direction acts in the model but is not in a column."""
    names = [c.removeprefix("dir_") for c in fit.chain.channels if c.startswith("dir_")]
    for name in names:
        given = points.table.get(f"dir_{name}")
        if given is None or given.isna().any():
            yield (
                f"the side from which {name} arrives is in no column dir_{name} and is taken from the order of the "
                f"rows; before its first move predictions lie midway between both sides, and half their difference is "
                f"in the uncertainty. If the rows are not driven in this order, write dir_{name}: +1 or -1"
            )


def _unfitted(fit: StoredFit, points: Survey) -> tuple[str, ...]:
    """A note on rows whose run (or file) was not fitted: they are predicted in the first fitted frame."""
    what = {"per-run": "run", "per-file": "file"}.get(fit.frame_mode)
    unknown = [label for label in dict.fromkeys(_labels(fit, points)) if label not in fit.frames]
    if what is None or not fit.frames or not unknown or (what == "file" and len(fit.frames) == 1):
        return ()
    more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
    return (
        f"{what} {unknown[0]}{more} was not fitted: predicted in the frame of {what} {next(iter(fit.frames))}. Where "
        "its own frame lies is not known: mx my mz of these rows may be off by that, which no uncertainty has; ex ey "
        "ez are along the axes of that frame",
    )


def _columns(chain: Chain, label: str | None) -> tuple[str, ...]:
    """Names of a chain's parameters, where those of the frame are its own."""
    return (*(frame_columns(chain, label) if label is not None else chain.frame_ids), *chain.ids[6:])


def _positions(fit: StoredFit, rows: list[Array], label: str | None) -> Array:
    """Predicted positions (n, 3) of rows in one measuring frame."""
    if fit.free_reference:
        return _predict_frame(fit, rows, label)[:, :3]
    p = np.array([fit.values.get(c, 0.0) for c in _columns(fit.chain, label)])
    actual = fit.chain.kernel("actual", outputs=(0, 1, 2))(rows, p).T
    return np.asarray((fit.frames[label] if label is not None else IDENTITY).apply(actual))


def _predict_frame(fit: StoredFit, rows: list[Array], label: str | None) -> Array:
    """Predictions (n, 9) of rows in one measuring frame: position, error, standard uncertainty."""
    chain = fit.chain
    pose: Pose = fit.frames[label] if label is not None else IDENTITY
    columns = _columns(chain, label)
    p = np.array([fit.values.get(c, 0.0) for c in columns])
    actual = chain.kernel("actual", outputs=(0, 1, 2))(rows, p).T
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(rows).T
    measured = pose.apply(actual)
    instrument = np.isin(columns, [*chain.instrument_ids])
    error = actual if not p[instrument].any() else chain.kernel("actual", outputs=(0, 1, 2))(rows, p * ~instrument).T
    unseen = {*chain.tool_ids, *(chain.frame_ids if label is None else ())}
    own = tuple(i for i in chain.ids if i not in unseen)
    design = chain.kernel("design", own, outputs=(0, 1, 2))(rows).reshape(len(own), 3, len(actual))
    design = np.einsum("ij,pjm->pim", pose.rotation, design)
    names = [columns[chain.index[i]] for i in own]
    if fit.free_reference:
        rigid = chain.kernel("design", chain.frame_ids, outputs=(0, 1, 2))(rows).reshape(6, 3, len(actual))
        parts = rigid_parts(chain, own)
        design = design - np.einsum("kim,kp->pim", rigid, parts)
        shift = np.einsum("kim,k->mi", rigid, parts @ [p[chain.index[i]] for i in own])
        error, measured = error - shift, measured - shift
    variance = _variance(fit, names, design) + fit.systematic**2
    return np.hstack([measured, pose.apply(error) - pose.apply(nominal), np.sqrt(variance).T])


def _variance(fit: StoredFit, names: list[str], design: Array) -> Array:
    """Variance (3, m) or (6, m): of the estimated groups, plus dependent parameters that are independent here."""
    place = {n: k for k, n in enumerate(names)}
    kept = [k for k, n in enumerate(fit.base) if n in place]
    base = design[[place[fit.base[k]] for k in kept]]
    covariance = fit.widened[np.ix_(kept, kept)]
    variance: Array = np.einsum("aim,ab,bim->im", base, covariance, base, optimize=True)
    for _, column in unidentified(fit, names, design):
        variance += np.square(column)
    return variance


def unidentified(fit: StoredFit, names: list[str], design: Array) -> Iterator[tuple[str, Array]]:
    """Parameters that were not identified and act here: names, and effects (3, m) of one standard uncertainty.

    A parameter that depends on the identified ones in the fitted rows, and here as well, has none. The standard
    uncertainty is its prior, or the size of the identified parameters of the same unit.

    Parameters
    ----------
    names : parameters of `design` (parameters, 3 or 6, m).
    """
    place = {n: k for k, n in enumerate(names)}
    kept = [k for k, n in enumerate(fit.base) if n in place]
    base = design[[place[fit.base[k]] for k in kept]]
    groups = np.zeros((len(kept), len(names)))
    for row, k in enumerate(kept):
        for member, coefficient in fit.groups[fit.base[k]].items():
            if member in place:
                groups[row, place[member]] = coefficient
    sizes = dict(zip(names, plausible_sizes(fit, names), strict=True))
    for name in names:
        if name in fit.base:
            continue
        column = design[place[name]]
        mix = groups[:, place[name]]
        some = np.flatnonzero(mix)
        left = column - np.tensordot(mix[some], base[some], axes=1)
        left[np.abs(left) < 1e-6 * np.abs(column).max(initial=1e-300)] = 0.0  # round-off: dependent here as well
        if left.any():
            yield name, left * sizes[name]


def plausible_sizes(fit: StoredFit, names: Sequence[str]) -> Array:
    """Standard deviations (parameters,) before a survey: priors, or the size of what was identified of that unit."""
    scale = _plausible(fit)
    known = {p.id: scale.get(p.unit, 0.0) if p.prior is None else p.prior for p in fit.chain.parameters}
    frames = {
        c: i for label in fit.frames for c, i in zip(frame_columns(fit.chain, label), fit.chain.frame_ids, strict=True)
    }
    return np.array([known.get(frames.get(name, name), 0.0) for name in names])


def _plausible(fit: StoredFit) -> dict[str, float]:
    """Size of an unidentified parameter by unit: as identified ones have it, with a prior that is worth a few of them.

    Few that happen to be small do not show that others are: inverse gamma prior of the variance, its posterior's mean
    of the scale.
    """
    out = dict(PLAUSIBLE_SIZES)
    for unit, usual in PLAUSIBLE_SIZES.items():
        known = (i for i in fit.base if fit.units[i] == unit and not i.startswith(("frame", "zero[")))
        squares = [fit.values.get(i, 0.0) ** 2 for i in known]
        out[unit] = float(np.sqrt((WORTH * usual**2 + sum(squares)) / (WORTH + len(squares))))
    return out
