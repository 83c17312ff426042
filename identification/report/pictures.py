"""Embedded figures of a report, each with a caption and an alternative text."""

from __future__ import annotations

import base64
from collections.abc import Callable
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from errormodel.machine import Joint
from identification.estimation.result import Fit
from identification.plots import style
from identification.plots.chain_drawing import draw_chain
from identification.plots.error_distribution import draw_error_distribution
from identification.plots.error_motions import draw_error_motions, moving_joints
from identification.plots.residuals import draw_residuals_by_order, draw_residuals_by_position
from identification.plots.volumetric_error import draw_volumetric_error

MOST_SVG_ARROWS = 120  # arrows, beyond which a PNG is smaller than an SVG
PICTURE_DPI = {"png": 150, "svg": 144}  # dots per inch; in an SVG this concerns dots only, which are pixels


class Picture(NamedTuple):
    """Function that draws the data URI, the caption and the alternative text."""

    source: Callable[[], str]
    caption: str
    alt: str


def pictures(fit: Fit) -> dict[str, list[Picture]]:
    """Figures by the section of the report they belong to."""
    points = bool(np.isfinite(fit.residuals).any())
    return {
        "result": _errors(fit) if points else [],
        "chain": [_chain(fit)],
        "motions": [_motions(fit, joint) for joint in moving_joints(fit)],
        "residuals": _residuals(fit) if points else [],
    }


def _errors(fit: Fit) -> list[Picture]:
    return [
        picture(
            partial(draw_error_distribution, fit),
            "How many rows have an error of which size: the further the fitted curve lies to the left of the nominal "
            "one, the more of the error the model removes; held-out and test curves show rows it has not seen.",
            "Histogram and cumulative distribution of the size of the error, before and after the fit",
        ),
        picture(
            partial(draw_volumetric_error, fit),
            "Where in the working volume the errors are and where they point, before and after the fit, both enlarged "
            "alike, in the axes of the machine's reference.",
            "Arrows in space along the error of each measured point, nominal on the left, fitted on the right",
            "png" if len(fit.residuals) > MOST_SVG_ARROWS else "svg",
        ),
    ]


def _motions(fit: Fit, joint: Joint) -> Picture:
    return picture(
        partial(draw_error_motions, fit, joint),
        f"Joint {joint.name}: its identified error motions over the travel, with bands of ± 2 standard uncertainties.",
        f"Curves of the translations and rotations of joint {joint.name} over its travel",
    )


def _residuals(fit: Fit) -> list[Picture]:
    return [
        picture(
            partial(draw_residuals_by_position, fit),
            "What is left over against the position of each joint: a dark line that wanders shows an error of that "
            "joint that the model does not have.",
            "Residuals x, y, z against each joint's position, with median and spread",
        ),
        picture(
            partial(draw_residuals_by_order, fit),
            "What is left over in the order of measuring: a drift here is warming up, or a frame that moved.",
            "Residuals x, y, z in the order of measuring, with median and spread",
        ),
    ]


def picture(draw: Callable[[], Figure], caption: str, alt: str, kind: Literal["svg", "png"] = "svg") -> Picture:
    """A figure for embedding; it is drawn when its source is requested."""
    return Picture(lambda: _embedded(style.render(draw(), kind, PICTURE_DPI[kind]), kind), caption, alt)


def _embedded(data: bytes, kind: str) -> str:
    media = "svg+xml" if kind == "svg" else kind
    return f"data:image/{media};base64,{base64.b64encode(data).decode('ascii')}"


def _chain(fit: Fit) -> Picture:
    names = ", ".join(e.name for e in fit.chain.machine.elements)
    return picture(
        partial(draw_chain, fit.chain.machine),
        "The chain from workpiece to tool: linear and rotary joints, the members between them, and the error motions "
        "that each may have.",
        f"Drawing of the chain: workpiece, {names}, tool point",
    )
