"""Where an instrument stands beside the machine, by its points: a person can see it, and no misfit shows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import FEWEST, Points, sheet
from identification.importing.words import LISTED
from identification.observation.assembly import frame_labels
from identification.observation.pose import Pose

# of the misfit, by which that of linear joints counted the other way round may be larger and still be the same: the
# machine is the same body then, turned, and only rounding differs
SAME_MISFIT_SHARE = 1e-3


@dataclass(frozen=True)
class Standing:
    """A measuring frame beside the machine.

    Attributes
    ----------
    label : of the frame.
    pose : from the machine's reference into it.
    alike : pairs of joints that may both count the other way round: the points then lie as near to their commands.
    """

    label: str
    pose: Pose
    alike: tuple[tuple[str, str], ...]


def standings(chain: Chain, survey: Survey, parts: Sequence[tuple[Index, Points]]) -> tuple[Standing, ...]:
    """The measuring frames whose place the points determine, each by the most rows of one file; none of fixed ones."""
    if survey.frame == "fixed":
        return ()
    labels, largest = frame_labels(survey), dict[str, tuple[Index, Points]]()
    for rows, part in parts:
        label = str(labels[rows[0]])
        if len(part) >= FEWEST and len(part) > len(largest.get(label, ((), ()))[0]):
            largest[label] = rows, part
    found = [(label, rows, part, part.pose()) for label, (rows, part) in largest.items()]
    return tuple(
        Standing(label, pose, _alike(chain, survey, rows, part, pose))
        for label, rows, part, pose in found
        if not len(pose.undetermined)
    )


def _alike(chain: Chain, survey: Survey, rows: Index, part: Points, pose: Pose) -> tuple[tuple[str, str], ...]:
    """Pairs of linear joints that moved, of which the points do not tell whether both count the other way round."""
    columns, most = sheet(chain, survey.table.iloc[rows]), (1 + SAME_MISFIT_SHARE) * part.misfit(pose)
    linear = [j.name for j in chain.machine.joints if j.type == "prismatic" and np.ptp(columns[j.name]) > 0]
    out = []
    for one, other in combinations(linear, 2):
        turned = Points.of(chain, columns | {name: -columns[name] for name in (one, other)}, fixed=False)
        if turned.misfit() <= most:
            out.append((one, other))
    return tuple(out)


def standing_lines(found: Sequence[Standing], survey: Survey) -> Iterator[str]:
    """Where each frame lies, its axes, and that a machine turned by 180 deg does not show."""
    station = np.array(getattr(survey.instrument, "station", np.zeros(3)), dtype=np.float64)
    what = "the tracker" if station.any() else "the origin of the measuring frame (a tracker's station)"
    for one in found[:LISTED]:
        at = one.pose.invert(station[None])[0]
        place = " ".join(f"{axis}={v:.0f}" for axis, v in zip("xyz", np.round(at) + 0.0, strict=True))
        axes = " and ".join(f"its {axis} along {_vector(one.pose.rotation[k])}" for k, axis in ((0, "x"), (2, "z")))
        whose = f" of {one.label}" if len(found) > 1 else ""
        yield f"{what}{whose} stands at {place} mm in the machine's reference, {axes}"
    if len(found) > LISTED:
        yield f"and {len(found) - LISTED} measuring frames more"
    pairs = dict.fromkeys(pair for one in found for pair in one.alike)
    if pairs:
        joints = ", or ".join(f"{one} and {other}" for one, other in pairs)
        yield (
            f"see whether it stands there: with both of {joints} counted the other way round (a machine turned by 180 "
            "deg) the points fit no worse, and only its place tells"
        )


def _vector(v: Array) -> str:
    return f"[{', '.join(f'{x:.3f}' for x in np.round(v, 3) + 0.0)}]"
