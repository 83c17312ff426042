"""Rows that may be wrong, with less evidence than a finding needs."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.data_checks.blunder import listed
from identification.diagnosis.data_checks.contaminated_noise import contaminated
from identification.diagnosis.data_checks.outliers import FEWEST, mean_squares, of_one_noise
from identification.estimation.result import Fit

MOST = 10_000  # rows: of more a few change nothing


def doubtful_rows(fit: Fit) -> tuple[str, ...]:
    """A note on rows that a few wrong ones in normal noise explain better than heavy tails of all, if there are some.

    Parameters
    ----------
    fit : with all findings, and without the rows that were left out.
    """
    residuals = of_one_noise(fit, fit.residuals)
    seen, square, components = mean_squares(residuals)
    if not FEWEST < len(square) < MOST:
        return ()
    lead, edge = contaminated(square, components)
    far = square > edge
    if lead <= 0 or not far.any():
        return ()
    rest = float(np.sqrt(square[~far].mean()))
    sizes = np.sqrt(np.nansum(np.square(residuals[seen][far]), axis=1)) / rest
    rows = fit.survey.table["row"].to_numpy()[seen][far]
    times = np.sqrt(square.mean()) / rest
    odds = float(f"{np.exp(lead):.2g}")
    which = f"rows {listed(rows.tolist())} lie {sizes.min():.2g} to" if len(rows) > 1 else f"row {rows[0]} lies"
    return (
        f"{which} {sizes.max():.2g} standard deviations of the other rows from the model: wrong by odds of "
        f"{odds:g} to 1 against heavy tails of the noise, which is less than outliers need; with "
        f"{'them' if len(rows) > 1 else 'it'} the noise seems {times:.3g} times as large. Measure there again, or fit "
        "with --robust",
    )
