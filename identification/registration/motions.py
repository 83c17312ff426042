"""Error motions of a joint from the displacement of the sensor, by Eq. (3) of the paper in exact form.

A point of the table is seen at ``p`` in the sensor's frame where ``E L M p`` is: mount ``M`` (sensor to tool frame),
lever ``L`` (tool to joint's frame), error motions ``E = Trans(d) Rx(ea) Ry(eb) Rz(ec)`` of the joint, actual minus
nominal. The artefact did not move: ``L M p_cold = E L M p_warm``. With the displacement ``p_cold = X p_warm``
therefore ``E = L M X M^-1 L^-1``. Units mm and rad.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from errormodel.arrays import Array

_STEPS = np.array([1e-2] * 3 + [1e-5] * 3)  # mm, rad; steps of central differences


def pose(six: Array) -> Array:
    """Matrix (4, 4) of ``Trans(x, y, z) Rx(a) Ry(b) Rz(c)`` from x, y, z in mm and a, b, c in rad (Eq. 5)."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("XYZ", six[3:]).as_matrix()
    matrix[:3, 3] = six[:3]
    return matrix


def six_of(matrix: Array) -> Array:
    """Inverse of :func:`pose`."""
    from scipy.spatial.transform import Rotation

    return np.concatenate([matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_euler("XYZ")])


def error_motions(displaced: Array, mount: Array, lever: Array) -> Array:
    """Six error motions (mm, rad) of the joint.

    Parameters
    ----------
    displaced : (4, 4)
        ``X``, from warm to cold coordinates in the sensor's frame.
    mount : (6,)
        Pose of the sensor's frame in the tool frame, mm and rad, in the order of :func:`pose`.
    lever : (3,)
        From the joint's frame to the tool frame, mm.
    """
    arm = pose(mount)
    arm[:3, 3] += lever
    return six_of(arm @ displaced @ np.linalg.inv(arm))


def with_uncertainty(
    displaced: Array, covariance: Array, mount: Array, mount_covariance: Array, lever: Array
) -> tuple[Array, Array]:
    """Six error motions and their covariance (6, 6), propagated from registration and mount through Eq. (3)."""
    by_registration = _sensitivity(lambda d: error_motions(pose(d) @ displaced, mount, lever))
    by_mount = _sensitivity(lambda d: error_motions(displaced, mount + d, lever))
    total = by_registration @ covariance @ by_registration.T + by_mount @ mount_covariance @ by_mount.T
    return error_motions(displaced, mount, lever), total


def _sensitivity(function: Callable[[Array], Array]) -> Array:
    columns = [(function(d) - function(-d)) / (2 * d.max()) for d in np.diag(_STEPS)]
    return np.stack(columns, axis=1)
