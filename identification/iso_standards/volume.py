"""Volumetric error of a fitted model in the measured volume: its largest value, and ranges of its components.

ISO 230-1:2012, 3.7, has the ranges of the deviations in X, Y and Z. The largest error is the size of the error vector
at the worst of many poses. A rigid motion of the whole workpiece is no error of the volume where the survey's frame was
free: the least-squares one is taken off. What held-out rows show beyond noise and model is added to the uncertainty.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, corners_of_cube
from identification.iso_standards.base import COVERAGE_FACTOR, Chart, Evaluation, Quantity, Sheet, Standard, spread
from identification.iso_standards.fitted import FittedMachine
from identification.uncertainty.budget import UNIDENTIFIED_LINE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POSES = 512  # Sobol points over the measured travels: the worst of them is within some percent of the worst of all
MOST_CORNERS = 64  # all those of six joints


class Volume(Standard):
    """The whole volume."""

    number = "volume"
    title = "Volumetric error in the measured volume (ISO 230-1:2012, 3.7)"

    def of_fit(self, model: FittedMachine) -> Evaluation:
        q, came = _poses(model)
        errors = model.errors(q, came)
        points = model.nominal(q)
        free = model.stored.frame_mode != "fixed"
        if free:
            errors = _without_rigid_motion(errors, points)
        size = np.linalg.norm(errors, axis=2)
        misfit = _misfit(model)
        worst = int(np.argmax(size[0]))
        basis = "covariance of the fit" + (", and what held-out rows show beyond it" if misfit else "")
        quantities = [_with("volume", "largest error in the volume", size.max(axis=1), basis, misfit)]
        quantities += [
            _with(
                f"V{axis}",
                f"range of the error in {axis.lower()} over the volume",
                np.ptp(errors[:, :, k], axis=1),
                basis,
                misfit,
            )
            for k, axis in enumerate("XYZ")
        ]
        share = np.quantile(size, 0.95, axis=1)
        quantities.append(_with("volume 95 %", "error that 95 % of the volume does not exceed", share, basis, misfit))
        shown = np.where([j.type == "rotary" for j in model.joints], np.degrees(q[worst]), q[worst])
        head = [*(j.name for j in model.joints), "ex / µm", "ey / µm", "ez / µm", "size / µm", "U / µm"]
        expanded = spread(size[:, worst])[1] or 0.0
        row = [
            *(f"{v:.4g}" for v in shown),
            *(f"{1e3 * v:.2f}" for v in errors[0, worst]),
            f"{1e3 * size[0, worst]:.2f}",
        ]
        row.append(f"{1e3 * np.hypot(expanded, COVERAGE_FACTOR * misfit):.2f}")
        sheet = Sheet("worst", f"The worst of {len(q)} poses, in mm and °", head, [row])
        notes = ["the volume is that of the measured travels"]
        notes += ["a rigid motion of the workpiece is taken off, since the measuring frame was free"] if free else []
        chart = Chart(
            "volume",
            "Share of the volume whose error does not exceed a size, with the band of the draws (95 %).",
            "Cumulative distribution of the size of the error in the volume",
            partial(_draw, size),
        )
        data: dict[str, Any] = {"poses": len(q), "worst": dict(zip(head, row, strict=True)), "misfit": misfit}
        return Evaluation(
            self.number, self.title, model.source, tuple(quantities), (sheet,), (chart,), tuple(notes), data
        )


def _with(symbol: str, words: str, values: Array, basis: str, misfit: float) -> Quantity:
    value, expanded = spread(values)
    if expanded is not None:
        expanded = float(np.hypot(expanded, COVERAGE_FACTOR * misfit))
    return Quantity(symbol, "", words, value, "mm", expanded, basis)


def _misfit(model: FittedMachine) -> float:
    """Standard deviation (mm) of one coordinate that the fit's budget has for what the model does not describe."""
    worst = (model.stored.data.get("budget") or {}).get("prediction") or {}
    lines = [i for i in worst.get("inputs", []) if i.get("sensitivity") == 1.0 and i.get("unit") == "mm"]
    lines = [i for i in lines if i.get("name") != UNIDENTIFIED_LINE]  # at a pose beyond the volume; draws have them
    return float(np.sqrt(sum(float(i["std"]) ** 2 for i in lines)))


def _poses(model: FittedMachine) -> tuple[Array, Array]:
    """Corners and Sobol points of the measured travels, and sides of approach."""
    from scipy.stats import qmc

    ranges = np.array([model.covered[j.name] for j in model.joints])
    moving = np.flatnonzero(np.ptp(ranges, axis=1) > 0)
    unit = qmc.Sobol(2 * len(moving), seed=0).random(POSES)
    corners = corners_of_cube(len(moving), MOST_CORNERS)
    place = np.vstack([corners, unit[:, : len(moving)]])
    q = np.tile(model.middle(), (len(place), 1))
    q[:, moving] = ranges[moving, 0] + place * np.ptp(ranges[moving], axis=1)
    came = np.ones_like(q)
    came[len(corners) :, moving] = np.where(unit[:, len(moving) :] < 0.5, -1.0, 1.0)
    return q, came


def _without_rigid_motion(errors: Array, points: Array) -> Array:
    """Errors (draws, n, 3) without their least-squares translation and small rotation."""
    about = points - points.mean(axis=0)
    turned = np.cross(np.eye(3)[:, None], about[None])  # (3, n, 3): e_k x r
    moved = np.broadcast_to(np.eye(3)[:, None], turned.shape)
    design = np.concatenate([moved, turned]).reshape(6, -1).T
    basis = np.linalg.qr(design)[0]
    flat = errors.reshape(len(errors), -1)
    return np.asarray((flat - (flat @ basis) @ basis.T).reshape(errors.shape))


def _draw(size: Array) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style

    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 3.0), facecolor="white")
    axes = style.panel(figure, 0.75, 0.55, 6.9, 2.2)
    ordered = 1e3 * np.sort(size, axis=1)
    share = 100 * (np.arange(size.shape[1]) + 0.5) / size.shape[1]
    if len(ordered) > 1:
        low, high = np.quantile(ordered[1:], (0.025, 0.975), axis=0)
        axes.fill_betweenx(share, low, high, color=style.FITTED, alpha=0.2, lw=0)
    axes.plot(ordered[0], share, color=style.FITTED, lw=1.4)
    axes.set(xlim=(0, None), ylim=(0, 100))
    style.dress(axes, "size of the error / µm", "share of the volume / %")
    return figure
