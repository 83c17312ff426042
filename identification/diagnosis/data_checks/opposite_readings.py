"""Readings of an observation that have the opposite sign of what its model says, beside points or other observations.

Lengths of a gauge with the nominal positions in place of those that were indicated, levels that were read the other way
round: such readings are the mirror image of right ones about those of a machine without errors. As they are and
mirrored, they are compared with what the rest of the survey predicts; what it leaves open, and the set-up, may take any
value, and so may the scales of the linear joints: the machine may have been warmer.

A reading less its prediction has the noise of the reading and the uncertainty of the prediction, which errors that the
model lacks enlarge. Both are estimated from these differences (restricted maximum likelihood), the latter as a multiple
of what the residuals of the rest say, so that noise need not be declared, and it does not matter if it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Joint
from errormodel.survey import Survey
from errormodel.surveys.observations import groups
from identification.diagnosis.data_checks.blunder import FEWEST, Blunder
from identification.diagnosis.decisions.constants import DECISIVE_ODDS
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.estimation.least_squares import Solution, solve
from identification.estimation.orthonormal_basis import LEFT, orthonormal_basis
from identification.observation.assembly import Problem, build
from identification.observation.models import OrientationView, PositionView, View
from identification.observation.normal_equations import design_rows, sampled
from identification.observation.readings import ReadingView

CLEAR = float(np.log(DECISIVE_ODDS))
MOST = 1000  # readings of an observation that are compared, evenly spread
WORST = 50.0  # times: variance of a prediction over that by the noise, where errors that the model lacks are smooth and
# only one coordinate in so many of some hundreds is independent of the others; by judgement
STEPS = 40  # of the noise level that is sought, over three decades

Own = Sequence[ReadingView]


@dataclass(frozen=True)
class Compared:
    """Readings of one observation beside what others predict of them.

    Attributes
    ----------
    as_is, mirrored : log likelihood of the readings, and of their mirror image.
    alone : of the readings, whatever the others predict.
    sizes : root mean squares of what is left of the readings and of their mirror image, mm or rad.
    """

    as_is: float
    mirrored: float
    alone: float
    sizes: tuple[float, float]

    @property
    def gain(self) -> float:
        """Log likelihood of the mirror image less that of whatever else may explain the readings."""
        return self.mirrored - max(self.as_is, self.alone)

    @property
    def opposite(self) -> bool:
        return self.gain > CLEAR

    @property
    def right(self) -> bool:
        return self.as_is - max(self.mirrored, self.alone) > CLEAR


def find_opposite_readings(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """Observations whose readings have the opposite sign, and the survey with these mirrored.

    Raises
    ------
    InputError
        Observations contradict each other, and nothing tells which of them has the opposite sign.
    """
    if not any(groups(survey.fit.table, survey.observations)):
        return None
    problem = build(chain, survey.fit)
    return opposite_readings(survey, problem, problem.views, log)


def opposite_readings(
    survey: Survey, problem: Problem, views: Sequence[View], log: DecisionLog = UNRECORDED
) -> Blunder | None:
    """The same of views that were made before, and may have robust weights."""
    own: dict[str, list[ReadingView]] = {}
    for view in views:
        if isinstance(view, ReadingView) and view.measured.any():  # touches of a plane, all 0, have no sign
            own.setdefault(view.label, []).append(view)
    rest = [v for v in views if not any(v is o for part in own.values() for o in part)]
    if not own or len(own) + bool(rest) < 2:
        return None
    found = _found(survey, problem, own, rest, log)
    return _mended(survey, own, found) if found else None


def _found(
    survey: Survey, problem: Problem, own: Mapping[str, list[ReadingView]], rest: Sequence[View], log: DecisionLog
) -> dict[str, Compared]:
    """The observations with the opposite sign, by name.

    Points have their sign from the commands. What they, and observations that agree with them, say decides first; then
    each observation that is left is compared with everything else.
    """
    sure: list[View] = [v for v in rest if isinstance(v, PositionView | OrientationView)]
    rest = [v for v in rest if not isinstance(v, PositionView | OrientationView)]
    waiting, found = dict(own), dict[str, Compared]()
    while sure and waiting:
        known = _known(problem, sure)
        told = {k: c for k, part in waiting.items() if (c := _compared(part, known)) and (c.opposite or c.right)}
        if not told:
            break
        for label, seen in told.items():
            part = waiting.pop(label)
            sure += part if seen.right else [_mirrored(v) for v in part]
            found |= {label: seen} if seen.opposite else {}
            log.add("reading-opposite-sign", "found" if seen.opposite else "passed", f"observation {label}",
                    seen.gain, CLEAR, beside="points")  # fmt: skip
    contrary = dict[str, Compared]()
    for label, part in waiting.items():
        more = [*rest, *(v for k, vs in waiting.items() if k != label for v in vs)]
        compared = _compared(part, _known(problem, [*sure, *more])) if more else None  # else points have had their say
        contrary |= {label: compared} if compared and compared.opposite else {}
        log.add("reading-opposite-sign", "found" if label in contrary else "passed", f"observation {label}",
                compared.gain if compared else None, CLEAR, beside="everything else" if more else "points")  # fmt: skip
    if contrary and (len(contrary) > 1 or len(waiting) + bool(rest) < 3):
        _refuse_contrary(survey, own, contrary)
    return found | contrary


def _known(problem: Problem, views: Sequence[View]) -> Solution:
    """What views determine in the linear model, in which readings are compared; also declared noise is estimated."""
    return solve(problem.chain, views, problem.unknowns, exact=False)


def _compared(own: Own, known: Solution) -> Compared | None:
    """Readings beside what is known of the machine; None where too few are left to compare."""
    views = [sampled(view, max(MOST // len(own), FEWEST)) for view in own]
    place = {name: k for k, name in enumerate(known.unknowns)}
    design = np.vstack([design_rows(view, place, len(view)) for view in views])
    gap = np.concatenate([view.beside_nominal() * view.whitener for view in views])
    base = known.groups.base
    others = np.setdiff1d(np.arange(len(place)), base)
    # parameters of which a group has the sum move without the group, whose base makes up for them
    free = design[:, others] - design[:, base] @ known.groups.coefficients[:, others]
    left = np.linalg.norm(free, axis=0) > LEFT * np.linalg.norm(design[:, others], axis=0)
    scales = np.vstack([_scales(view) * view.whitener[:, None] for view in views])
    q = _basis(np.hstack([free[:, left], scales]))
    if len(gap) - q.shape[1] < FEWEST or not len(base):
        return None
    across = np.linalg.qr(np.hstack([q, np.eye(len(gap))]))[0][:, q.shape[1] : len(gap)]  # what nothing free explains
    spread = across.T @ design[:, base]
    variance, axes = np.linalg.eigh(spread @ known.covariance @ spread.T)
    read, said = (axes.T @ (across.T @ r) for r in (gap, design @ known.values))
    weight = float(np.sqrt(sum(np.square(view.whitener).sum() for view in views)))
    as_is, mirrored = float(np.linalg.norm(read - said)) / weight, float(np.linalg.norm(read + said)) / weight
    one, other, alone = (_log_likelihood(r, variance) for r in (read - said, read + said, read))
    return Compared(one, other, alone, (as_is, mirrored))


def _log_likelihood(values: Array, variance: Array) -> float:
    """Largest log likelihood of normal values (n,) of variances ``a + b variance``, b at most `WORST`; no constant."""
    mean = float(np.mean(np.square(values))) + 1e-300
    out = []
    for noise in mean * np.geomspace(1e-6, 1.0, STEPS):
        for share in (0.0, *np.geomspace(1 / WORST, WORST, STEPS // 4)):
            v = noise + share * np.maximum(variance, 0.0)
            out.append(-0.5 * float((np.square(values) / v + np.log(v)).sum()))
    return max(out)


def _basis(columns: Array) -> Array:
    norms = np.linalg.norm(columns, axis=0)
    return orthonormal_basis(columns[:, norms > 0] / norms[norms > 0])


def _mirrored(view: ReadingView) -> ReadingView:
    return replace(view, measured=view.measured - 2 * view.beside_nominal())


def _scales(view: ReadingView) -> Array:
    """Change of the readings with the scale of each linear joint, (n, linear joints)."""
    chain, poses = view.chain, view.observation.poses
    levers = view.levers()[:, 0].reshape(poses, -1, len(view))[::-1]  # the first pose first, as in the rows
    each = len(chain.channels)
    columns = []
    for joint in (e for e in chain.machine.elements if isinstance(e, Joint) and e.type == "prismatic"):
        first = 6 * chain.element_names.index(joint.name)
        along = np.einsum("pkn,k->pn", levers[:, first : first + 3], np.array(joint.axis))
        at = np.array([view.rows[p * each + chain.channels.index(joint.name)] for p in range(poses)])
        columns.append((along * at).sum(axis=0))
    return np.column_stack(columns) if columns else np.zeros((len(view), 0))


def _mended(survey: Survey, own: Mapping[str, Own], found: Mapping[str, Compared]) -> Blunder:
    table = survey.table.copy()
    fitted = np.flatnonzero((table["role"] == "fit").to_numpy())
    columns, rows = dict[str, None](), list[int]()
    for view in (v for label in found for v in own[label]):
        column, at = view.observation.reading, table.index[fitted[view.index]]
        table.loc[at, column] = _mirrored(view).measured
        rows += table.loc[at, "row"].tolist()
        columns[column] = None
    return Blunder(
        f"the readings of {_named(found)} have the opposite sign: {_sizes(own, found)}",
        replace(survey, table=table),
        driver=tuple(columns),
        rows=tuple(sorted(map(int, rows))),
        cure=_cure(own, found),
        mended="; they are taken mirrored about those of a machine without errors",
    )


def _refuse_contrary(survey: Survey, own: Mapping[str, Own], contrary: Mapping[str, Compared]) -> None:
    found = (
        f"the readings of {_named(contrary)} contradict the rest of the survey, and do not with the opposite sign: "
        f"{_sizes(own, contrary)}. Which of them is wrong they do not tell"
    )
    raise InputError(str(survey.source), found, f"{_cure(own, contrary)}. Points (mx my mz) beside them would tell")


def _named(labels: Mapping[str, Compared]) -> str:
    return f"observation{'s' if len(labels) > 1 else ''} {', '.join(labels)}"


def _sizes(own: Mapping[str, Own], found: Mapping[str, Compared]) -> str:
    """How far the readings lie, as they are and mirrored."""
    out = []
    for label, c in found.items():
        factor, unit = (1e6, "urad") if own[label][0].turns else (1e3, "um")
        as_is, mirrored = (f"{factor * size:.3g} {unit}" for size in c.sizes)
        name = f"those of {label}" if len(found) > 1 else "they"
        out.append(f"{name} lie {as_is} rms from what the rest shows as they are, {mirrored} mirrored")
    return "; ".join(out)


def _cure(own: Mapping[str, Own], found: Mapping[str, Compared]) -> str:
    """What makes readings positive, of each type."""
    kinds = {o.type: o for o in (own[label][0].observation for label in found)}
    return "; ".join(
        f"write {o.type} so that {o.sign}" if o.sign else f"turn the sign of {o.type}" for o in kinds.values()
    )
