"""Thermal drifts of a cycle that was not fitted: measured, and predicted by the thermal model and by regressions."""

from __future__ import annotations

from math import ceil

import numpy as np
from matplotlib.figure import Figure

from errormodel.conventions import unit_of
from identification.plots import style
from identification.results.parameter_table import printed
from identification.thermal_drift.drift_model import Thermal
from identification.thermal_drift.selection import centred

DRIFT_COLUMNS = 3  # panels in a row
DRIFT_ROW_IN = 1.75  # inches: height of a row


def draw_thermal_drift(result: Thermal) -> Figure:
    """One panel per error motion: predicted minus measured, each recording relative to its own zero, over hours."""
    drifts = result.recordings.test
    rows = ceil(len(drifts) / DRIFT_COLUMNS)
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, DRIFT_ROW_IN * rows + 0.6), facecolor="white")
    for k, (drift, own, (lagged, usual)) in enumerate(zip(drifts, result.motions, result.predicted, strict=True)):
        left, low = 0.62 + 2.5 * (k % DRIFT_COLUMNS), 0.5 + DRIFT_ROW_IN * (rows - 1 - k // DRIFT_COLUMNS)
        axes = style.panel(figure, left, low, 1.85, DRIFT_ROW_IN - 0.62)
        factor, unit = printed(unit_of(drift.motion))
        time = result.recordings.survey.table["time"].to_numpy(dtype=np.float64)[drift.rows]
        hours = (time - time.min()) / 3600
        for values, colour, label in (
            (usual, style.NOMINAL, "stepwise regression"), (lagged, style.FITTED, "lagged temperatures"),
        ):  # fmt: skip
            gap = factor * centred(values - drift.values, drift.series)
            axes.plot(hours, gap, ".", ms=1.6, color=colour, label=label, alpha=0.8)
        axes.axhspan(-2 * factor * own.noise, 2 * factor * own.noise, color=style.FAINT, lw=0, label="noise (2 sigma)")
        bottom = k // DRIFT_COLUMNS == rows - 1 or k + DRIFT_COLUMNS >= len(drifts)
        size = factor * np.ptp(centred(drift.values, drift.series))
        title = f"{own.symbol or own.joint + '.' + own.motion}: drifts by {size:.0f} {unit}"
        style.dress(axes, "hours" if bottom else "", unit if k % DRIFT_COLUMNS == 0 else "", title)
        if k == 0:
            handles, labels = axes.get_legend_handles_labels()
            figure.legend(
                handles, labels, loc="upper left", ncols=3, fontsize=style.SMALL_TEXT, frameon=False, markerscale=5
            )
    return figure
