"""Mount of the sensor in the tool frame, from a machined plane and circular pocket (sections 3.2 and 4.2 of the paper).

beta from the tilt of the profiles on the plane; alpha, gamma, dx, dy, dz from the edge of the pocket, which lies on a
circle of known centre, radius and height in the tool frame: Eqs. (5) to (9), by non-linear least squares. All rows are
solved together, so that the tilt is that of Eq. (6) exactly and not beta itself.

One pocket determines five of the six. A circle is rotationally symmetric, so in points of the sensor's own frame gamma
is not identifiable. In profiles stacked along the machine's travel it is, as a shear that makes the circle an ellipse;
but then alpha, which does not tilt such a stack, is not. The shape of the ellipse distinguishes the two kinds of scan.
The unidentifiable angle is set to 0 with standard uncertainty SQUARENESS_RAD, which is propagated with the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import MAD_STD, Array, Mask
from errormodel.exceptions import InputError
from identification.registration.cleaning import breaks, lines_of
from identification.registration.form import CalibrationBlock, MountBlock
from identification.registration.motions import pose

# rad: angle after mounting with a dial indicator; the size of these angles in the paper's section 5
SQUARENESS_RAD = 0.01
# mm: initial noise of an edge's points, replaced by that of the residuals
EDGE_NOISE_MM = 0.01
# of the radius: width of the ring within which edge points are accepted; by judgement
RING_SHARE = 0.2
FEWEST_EDGE_POINTS = 12  # points of an edge that a fit needs; by judgement
EDGE_CLIP_SIGMA = 4.0  # robust standard deviations beyond which an edge point is left out; by judgement
ELLIPSE_SIGMA = 5.0  # standard deviations from which the ellipse counts as established; by judgement
MOUNT_ROUNDS = 6  # iterations of weights and outliers; by judgement


@dataclass(frozen=True)
class Mount:
    """Pose of the sensor's frame in the tool frame.

    Attributes
    ----------
    six : (6,)
        Translation in mm and alpha, beta, gamma in rad, ``R = Rx Ry Rz``.
    covariance : (6, 6)
    stacked : bool
        The clouds are profiles stacked along the machine's travel, not along the sensor's own y.
    notes : tuple of str
    """

    six: Array
    covariance: Array
    stacked: bool = False
    notes: tuple[str, ...] = ()

    def in_sensor_frame(self, points: Array) -> Array:
        """Points (n, 3) of a cloud in the axes of the sensor."""
        if not self.stacked:
            return points
        travel = pose(self.six)[1, :3]  # the machine's y axis in the sensor's axes
        turned: Array = points + points[:, 1:2] * (travel - np.array([0.0, 1.0, 0.0]))
        return turned


def given_mount(block: MountBlock) -> Mount:
    """Mount as given by the user."""
    six = np.r_[block.translation, block.rotation].astype(np.float64)
    if block.std is None:
        note = "the mount is taken as exact; write std: {translation: 0.1, rotation: 0.001} (mm, rad) below mount:"
        return Mount(six, np.zeros((6, 6)), notes=(note,))
    variances = np.repeat([block.std.translation, block.std.rotation], 3) ** 2
    return Mount(six, np.diag(variances))


def identify_mount(plane: Array, circle: Array, block: CalibrationBlock, name: str) -> Mount:
    """Identify the mount from the clouds (n, 3) of the plane and of the pocket, or of the pocket's edge.

    Raises
    ------
    InputError
        The cloud shows no edge on a circle of that radius.
    """
    tilt, tilt_std = profile_tilt(plane)
    edge = _edge(circle, block.radius, name)
    stacked = _solve(edge, tilt, tilt_std, block, stacked=True)
    gamma, std = stacked.six[5], float(np.sqrt(stacked.covariance[5, 5]))
    if abs(gamma) > max(ELLIPSE_SIGMA * std, 2e-4):
        return replace(stacked, notes=(_unseen("alpha", "pitch does not tilt profiles stacked along the travel"),))
    in_frame = _solve(edge, tilt, tilt_std, block, stacked=False)
    return replace(in_frame, notes=(_unseen("gamma", "a circle looks the same from all sides"),))


def _unseen(angle: str, why: str) -> str:
    return (
        f"{angle} of the mount cannot be seen in this calibration ({why}): taken as 0 +- {SQUARENESS_RAD:g} rad, "
        "which is part of the uncertainties. If it is known, write mount: in place of calibration:"
    )


def profile_tilt(plane: Array) -> tuple[float, float]:
    """Mean slope dz/dx of the profiles on a plane (n, 3), and its standard uncertainty from their scatter."""
    good = np.ones(len(plane), dtype=np.bool_)
    lines = lines_of(plane)
    for _ in range(MOUNT_ROUNDS):
        points, label = plane[lines.order][good[lines.order]], np.cumsum(lines.first)[good[lines.order]]
        count = np.maximum(np.bincount(label), 1)
        x, z = (points[:, k] - (np.bincount(label, points[:, k]) / count)[label] for k in (0, 2))
        moment, cross = np.bincount(label, x * x), np.bincount(label, x * z)
        slope = float(cross.sum() / moment.sum())
        residual = z - slope * x
        limit = EDGE_CLIP_SIGMA * MAD_STD * float(np.median(np.abs(residual)))
        good[lines.order[good[lines.order]]] = np.abs(residual) <= max(limit, 1e-9)
    used = moment > 0
    spread = (cross - slope * moment)[used]
    std = float(np.sqrt(np.sum(spread**2))) / float(moment.sum())  # profiles are the independent units
    return slope, max(std, 1e-9)


def _edge(cloud: Array, radius: float, name: str) -> Array:
    """Points (n, 3) on the pocket's upper edge: the cloud itself if it is a ring, else the breaks of its profiles."""
    ring = _on_circle(cloud, radius)
    if ring.mean() > 0.7:
        return cloud[ring]
    lines = lines_of(cloud)
    ordered = cloud[lines.order]
    broken = np.flatnonzero(breaks(cloud, lines) & ~lines.first)
    upper = np.where(ordered[broken, 2] > ordered[broken - 1, 2], broken, broken - 1)
    points: Array = ordered[np.unique(upper)]
    if len(points) >= FEWEST_EDGE_POINTS:
        points = points[_on_circle(points, radius)]
    if len(points) < FEWEST_EDGE_POINTS:
        found = f"{len(points)} points on an edge of radius {radius:g} mm"
        raise InputError(name, found, "Give the scan of the pocket with its whole edge, or the points of the edge")
    return points


def _on_circle(points: Array, radius: float) -> Mask:
    """Points near a circle of that radius, with the centre on which most of them agree."""
    from scipy.optimize import least_squares

    xy = points[:: max(1, len(points) // 5000), :2]

    def gap(centre: Array) -> Array:
        return np.asarray(np.hypot(*(xy - centre).T) - radius)

    start = (xy.min(axis=0) + xy.max(axis=0)) / 2
    centre = least_squares(gap, start, loss="soft_l1", f_scale=0.05).x
    near: Mask = np.abs(np.hypot(*(points[:, :2] - centre).T) - radius) < RING_SHARE * radius
    return near


def _solve(edge: Array, tilt: float, tilt_std: float, block: CalibrationBlock, stacked: bool) -> Mount:
    """Solve Eq. (8) and the tilt by least squares, with weights and outliers from the residuals."""
    from scipy.optimize import least_squares

    centre, level = np.array(block.centre), block.centre[2] + block.height
    travel = edge * np.array([0.0, 1.0, 0.0]) if stacked else np.zeros_like(edge)
    points, sizes = edge - travel, np.full(2, EDGE_NOISE_MM)
    good = np.ones(len(edge), dtype=np.bool_)

    def gaps(six: Array) -> tuple[Array, Array]:
        matrix = pose(six)
        there = points @ matrix[:3, :3].T + matrix[:3, 3] + travel
        return np.hypot(*(there[:, :2] - centre[:2]).T) - block.radius, there[:, 2] - level

    def rows(six: Array) -> Array:
        radial, height = (gap[good] / size for gap, size in zip(gaps(six), sizes, strict=True))
        matrix = pose(six)
        slope = -matrix[2, 0] / matrix[2, 2]  # slope along the sensor's x of a plane normal to the tool's z
        return np.concatenate([radial, height, [(slope - tilt) / tilt_std, six[3 if stacked else 5] / SQUARENESS_RAD]])

    six = np.r_[centre[:2] - edge[:, :2].mean(axis=0), level - edge[:, 2].mean(), 0.0, np.arctan(tilt), 0.0]
    scale = np.r_[np.ones(3), np.full(3, 1e-3)]
    for _ in range(MOUNT_ROUNDS):
        found = least_squares(rows, six, x_scale=scale, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        six = found.x
        both = gaps(six)
        sizes = np.array([max(MAD_STD * float(np.median(np.abs(gap[good]))), 1e-7) for gap in both])
        good = np.logical_and.reduce([np.abs(g) <= EDGE_CLIP_SIGMA * s for g, s in zip(both, sizes, strict=True)])
    scaled = found.jac * scale
    covariance = np.linalg.pinv(scaled.T @ scaled, hermitian=True) * np.outer(scale, scale)
    return Mount(six, covariance, stacked)
