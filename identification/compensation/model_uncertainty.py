"""Standard uncertainty of the fitted model that a compensation is computed from, and advice that follows from it.

A claim "by the model" knows nothing of it: what a machine shows after a compensation is the square root of the sum of
the squares of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Target
from errormodel.controllers.setup import Setup
from identification.compensation.assessment import JOINT_ROWS, OTHER_TOOLS, Correct, Figures, assess, fresh_rows
from identification.compensation.field import Field
from identification.compensation.rows import Rows
from identification.compensation.sample import frame_motion, framed
from identification.compensation.volume import Volume
from identification.results.stored_fit import StoredFit
from identification.uncertainty.prediction import unidentified

# A correction whose standard uncertainty is u leaves u of an error e, and what the model shows is hypot(e, u): where u
# is more than this share of it, a correction adds more than it takes away.
HARMFUL_SHARE = np.sqrt(0.5)
LONGER_MM = 100.0  # by which another tool is longer in what is said of such tools; by judgement
ALONG_Z = 0.99985  # cosine of one degree between tool and Z axis: a tool at a larger angle does not lie along it


@dataclass(frozen=True)
class Uncertain:
    """Root mean squares over poses, after the best-fit frame: of what the model shows, and of what is unsure of it.

    Attributes
    ----------
    shown : the error, mm, or its change per mm of tool length.
    identified : its standard uncertainty by what was identified; `unseen` : by parameters that were not.
    """

    shown: float
    identified: float
    unseen: float

    @property
    def whole(self) -> float:
        return float(np.hypot(self.identified, self.unseen))


def model_uncertainty(fit: StoredFit, volume: Volume, rows: Rows) -> Uncertain:
    """Standard uncertainty (k = 1, mm) of the predicted error, with the size of what no row determined."""
    return _uncertain(fit, volume, rows, [(1.0, rows.tool)])


def length_uncertainty(fit: StoredFit, volume: Volume, rows: Rows, along: Array) -> Uncertain:
    """The same of the change of the error per mm by which a tool is longer `along` a direction of the last frame."""
    return _uncertain(fit, volume, rows, [(1 / LONGER_MM, rows.tool + LONGER_MM * along), (-1 / LONGER_MM, rows.tool)])


def _uncertain(fit: StoredFit, volume: Volume, rows: Rows, parts: Sequence[tuple[float, Array]]) -> Uncertain:
    field = volume.field
    frame = frame_motion(field.nominal(rows.q, rows.tool), volume.free, volume.turns)
    shown = np.zeros((len(rows), 3))
    for factor, tool in parts:
        shown += factor * (field.actual(rows.q, rows.direction, tool) - field.nominal(rows.q, tool))
    found = sensitivities_at(fit, field, rows.q, rows.direction, parts)
    base = _framed(found.base, frame)
    known = float(np.sum(found.covariance * (base.T @ base)))
    more = float(np.sum(np.square(_framed(found.unseen, frame))))
    return Uncertain(*(float(np.sqrt(v / len(rows))) for v in (np.sum(np.square(framed(shown, frame))), known, more)))


@dataclass(frozen=True)
class Sensitivities:
    """Sensitivities of the errors at n poses to parameters, mm, (3 n, k): x, y and z of one pose after another.

    Attributes
    ----------
    base : by each identified parameter, and `covariance` (k, k) of these.
    unseen : by one standard uncertainty of each parameter that no row determined, and their `names`.
    """

    base: Array
    covariance: Array
    unseen: Array
    names: tuple[str, ...]


def sensitivities_at(
    fit: StoredFit, field: Field, q: Array, direction: Array, parts: Sequence[tuple[float, Array | None]]
) -> Sensitivities:
    """Sensitivities of a sum of errors with some tools, each times its factor; None: the machine's own tool."""
    chain = fit.chain
    others = {*chain.tool_ids, *chain.frame_ids, *chain.instrument_ids}
    own = tuple(i for i in chain.ids if i not in others)
    kernel, design = chain.kernel("design", own, outputs=(0, 1, 2)), np.zeros((len(own), 3, len(q)))
    for factor, tool in parts:
        design += factor * kernel(field.rows(q, direction, tool)).reshape(design.shape)
    place = {n: k for k, n in enumerate(own)}
    kept = [k for k, n in enumerate(fit.base) if n in place]
    unseen = dict(unidentified(fit, list(own), design))
    flat = [
        effects.transpose(2, 1, 0).reshape(3 * len(q), len(effects))
        for effects in (
            design[[place[fit.base[k]] for k in kept]], np.array([*unseen.values()]).reshape(-1, 3, len(q))
        )
    ]  # fmt: skip
    return Sensitivities(flat[0], fit.widened[np.ix_(kept, kept)], flat[1], tuple(unseen))


def _framed(flat: Array, frame: Array) -> Array:
    """Columns (3 n, k) after the least-squares motion of the frame."""
    motions = frame.reshape(len(flat), -1)
    if not motions.shape[1]:
        return flat
    return np.asarray(flat - motions @ np.linalg.lstsq(motions, flat, rcond=1e-9)[0], np.float64)


def judged(fit: StoredFit | None, volume: Volume, correct: Correct, held: Rows | None, seed: int) -> list[Figures]:
    """Residual errors of a compensation (:func:`assess`), with the uncertainty of the model over the volume.

    Parameters
    ----------
    fit : None where error motions of single joints were read, of which the fit says nothing at the tip.
    """
    found = assess(volume, correct, held, seed)
    if fit is None:
        return found
    unsure = model_uncertainty(fit, volume, fresh_rows(volume, seed)).whole
    return [replace(found[0], model_um=1e3 * unsure), *found[1:]]


def against_model(figures: Sequence[Figures]) -> str:
    """Why corrections by this model should not be used at all; empty: nothing speaks against them."""
    cure = "measure more poses (errormodel plan), or declare fewer errors in machine.yaml"
    for f in figures:
        if f.model_um is not None and f.model_um > HARMFUL_SHARE * f.before.rms_um:
            return (
                f"the model's own standard uncertainty over the volume is {_digits(f.model_um)} um rms, and the errors "
                f"that it shows are {_digits(f.before.rms_um)} um: {cure}"
            )
        unseen = f.model_um is None and not f.poses.endswith(OTHER_TOOLS) and JOINT_ROWS not in f.poses
        if unseen and f.ideal.rms_um >= f.before.rms_um:
            return (
                f"{f.poses} come out no better even by an ideal compensation ({f.before.rms_um:.1f} um rms before, "
                f"{f.ideal.rms_um:.1f} after): {cure}"
            )
    return ""


def _digits(um: float) -> str:
    return f"{um:.1f}" if um >= 1 else f"{um:.2g}"  # machines of a millimetre too


def following(
    fit: StoredFit | None, volume: Volume, setup: Setup, target: Target, seed: int
) -> tuple[Setup, list[str]]:
    """The setup, without corrections that follow the tool's length where the survey does not show how; what to say.

    A control adds the length of a tool along the Z axis, so that a tool that lies otherwise is not followed either.
    """
    field = volume.field
    if fit is None or not getattr(target, "follows_tool", False) or not any(setup.along_tool):
        return setup, []
    along = np.asarray(setup.along_tool)
    z = np.asarray(setup.axis("Z").along) if "Z" in setup.names else np.zeros(3)
    if abs(float(field.chain.frames({})[-1][:3, :3] @ along @ z)) < ALONG_Z:
        said = "the tool does not lie along Z: the table does not follow the length of tools"
        return replace(setup, follow=False), [said]
    rows = fresh_rows(volume, seed)
    found = length_uncertainty(fit, volume, rows, along)
    if found.identified > HARMFUL_SHARE * found.shown:
        said = (
            "the survey does not show how errors change with the length of the tool (by "
            f"{1e3 * LONGER_MM * found.shown:.1f} um for {LONGER_MM:g} mm, with a standard uncertainty of "
            f"{1e3 * LONGER_MM * found.identified:.1f} um): the table does not follow it. Measure with two lengths"
        )
        return replace(setup, follow=False), [said]
    return setup, [
        f"with a tool {LONGER_MM:g} mm longer, followed, the model is less certain by "
        f"{1e3 * LONGER_MM * found.whole:.1f} um (standard uncertainty): errors that act on other tools only were not "
        "measured"
    ]
