"""Fitted error motions of a joint over its travel, with their uncertainty."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS, iso_symbol
from errormodel.machine import Joint
from identification.estimation.result import Fit
from identification.observation.models import MotionView
from identification.plots import style

MOTION_POINTS = 241  # points of a curve
MOST_DOTS = 400  # dots of direct measurements of a motion
LINE_STYLES = ("-", "--", "-.")  # styles of the motions about x, y, z


def moving_joints(fit: Fit) -> list[Joint]:
    """Joints with at least one identified error motion."""
    found = {fit.chain.parameters[fit.chain.index[i]].element for i in _base(fit)}
    return [j for j in fit.chain.machine.joints if j.name in found]


def draw_error_motions(fit: Fit, joint: Joint) -> Figure:
    """Identified error motions of one joint, with a band of twice their standard uncertainty.

    Translations in um on the left, rotations in urad on the right, over the joint's travel; a kind without identified
    motions has no panel. Dots are direct measurements of the motion less the instrument's zero; shaded ends of the
    travel hold no measured rows.
    """
    q = np.linspace(*joint.travel, MOTION_POINTS)
    value, deviation = _curves(fit, joint, q)
    along = style.shown(joint, q)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 2.75), facecolor="white")
    kinds = [("translation", "µm", 1e3, 0), ("rotation", "µrad", 1e6, 3)]
    kinds = [kind for kind in kinds if deviation[kind[3] : kind[3] + 3].any()] or kinds[:1]
    for side, (kind, unit, factor, first) in enumerate(kinds):
        axes = style.panel(figure, 0.68 + 4.0 * side, 0.47, 3.08, 1.8)
        style.dress(axes, "", f"{kind} / {unit}")
        for k in range(3):
            row = first + k
            if deviation[row].any():
                dots = _measured(fit, joint, row)
                if dots[0].size:
                    axes.plot(style.shown(joint, dots[0]), factor * dots[1], ".", ms=4, mew=0,
                              color=style.AXIS_COLOURS[k], alpha=0.6, rasterized=True)  # fmt: skip
                middle, width = factor * value[row], 2 * factor * deviation[row]
                axes.fill_between(along, middle - width, middle + width, color=style.AXIS_COLOURS[k], alpha=0.2, lw=0)
                label = style.plain(iso_symbol(joint.name, MOTIONS[row]), 12)
                axes.plot(along, middle, color=style.AXIS_COLOURS[k], ls=LINE_STYLES[k], lw=1.6, label=label)
        axes.axhline(0, color=style.MUTED, lw=0.7)
        axes.set_xlim(along[0], along[-1])
        style.dress_position(axes, joint)
        _shade_unmeasured(fit, joint, axes)
        size = style.BODY_TEXT if len(joint.name) < 5 else style.SMALL_TEXT
        axes.legend(
            loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=3, frameon=False, labelcolor=style.INK,
            fontsize=size, handlelength=1.9, columnspacing=1.1,
        )  # fmt: skip
    return figure


def _base(fit: Fit) -> list[str]:
    """Identified parameters of geometric error motions; effects depend on more than the joint's position."""
    names = {fit.solution.unknowns[j] for j in fit.solution.groups.base}
    own = (p for p in fit.chain.parameters if p.id in fit.chain.machine_ids and p.id in names)
    return [p.id for p in own if p.id not in fit.chain.of_effects]


def _curves(fit: Fit, joint: Joint, q: Array) -> tuple[Array, Array]:
    """Six error motions at positions `q` and their standard uncertainties, (6, n) in mm and rad."""
    chain, solution = fit.chain, fit.solution
    ids = tuple(i for i in _base(fit) if chain.parameters[chain.index[i]].element == joint.name)
    names = [solution.unknowns[j] for j in solution.groups.base]
    here = [names.index(i) for i in ids]
    rows = [q if c == joint.name else np.zeros_like(q) for c in chain.channels]
    terms = chain.kernel("terms", ids)(rows).reshape(len(ids) + 6, 6, len(q))[: len(ids)]
    value = np.tensordot(solution.values[solution.groups.base[here]], terms, axes=1)
    covariance = solution.covariance[np.ix_(here, here)] * fit.inflation**2
    variance = np.einsum("amq,ab,bmq->mq", terms, covariance, terms)
    return value, np.sqrt(np.maximum(variance, 0.0))


def _measured(fit: Fit, joint: Joint, row: int) -> tuple[Array, Array]:
    """Positions where this motion itself was measured, and its values beyond the instrument's zero."""
    named = fit.solution.named()
    channel = fit.chain.channels.index(joint.name)
    found = [np.zeros((2, 0))]
    for view in fit.problem.views:
        if isinstance(view, MotionView) and view.outputs == (row,) and set(view.ids) & set(_base(fit)):
            some = np.unique(np.linspace(0, len(view) - 1, MOST_DOTS).astype(int))
            zero = named.get(view.columns[len(view.ids) + row], 0.0)
            if fit.chain.parameters[fit.chain.index[view.ids[0]]].element == joint.name:
                found.append(np.array([view.rows[channel][some], view.measured[some] - zero]))
    position, value = np.concatenate(found, axis=1)
    return position, value


def _shade_unmeasured(fit: Fit, joint: Joint, axes: Axes) -> None:
    position = style.shown(joint, fit.survey.table[joint.name].to_numpy(dtype=float))
    low, high = np.nanmin(position), np.nanmax(position)
    left, right = axes.get_xlim()
    for start, end in ((left, low), (high, right)):
        if end - start > 0.02 * (right - left):
            axes.axvspan(start, end, color=style.FAINT, alpha=0.6, lw=0, zorder=0)
