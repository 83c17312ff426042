"""Components of positions that no fitted row has: where the instrument has its zero along them is not known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from identification.observation.assembly import frame_labels

if TYPE_CHECKING:
    from identification.estimation.result import Fit

COMPONENTS = ("x", "y", "z")


def unmeasured(fit: Fit) -> dict[str, list[str]]:
    """By measuring frame the components that no row of it has; only of frames that were placed by their rows."""
    survey, out = fit.survey.fit, dict[str, list[str]]()
    seen = np.isfinite(survey.measured)
    labels = frame_labels(survey, fit.survey.frame)
    for label in fit.problem.frames:
        own = seen[labels == label].any(axis=0)
        if own.any() and not own.all():
            out[label] = [c for c, there in zip(COMPONENTS, own, strict=True) if not there]
    return out


def unmeasured_notes(
    missing: Mapping[str, Sequence[str]], frames: Sequence[str], labels: Sequence[str]
) -> Iterator[str]:
    """Notes on predicted positions along components whose zero is not known.

    Parameters
    ----------
    missing : as `unmeasured` returns them; `frames`: labels of those that were fitted; `labels`: of the rows' frames.
    """
    first = next(iter(frames), "")
    used = dict.fromkeys(label if label in frames else first for label in labels)
    for names in dict.fromkeys(tuple(missing.get(label, ())) for label in used):
        if names:
            columns = " and ".join(f"m{name}" for name in names)
            yield (
                f"no fitted row has {columns}: where the instrument has its zero along {' and '.join(names)} is not "
                f"known. {columns} may be off by any length, and no uncertainty has that; errors are relative to the "
                f"machine's own zero. Measure {columns} in some rows of the survey"
            )
