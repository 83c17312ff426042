"""Registration: point clouds of artefacts, cold and warm, converted to a survey of thermal error motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError, nearest
from errormodel.yamlfile import Document
from identification.registration.cleaning import clean, point_cloud_library
from identification.registration.displacement import Displacement, displacement
from identification.registration.folders import clouds_in, labels, time_in
from identification.registration.form import Profiler, read_profiler
from identification.registration.motions import with_uncertainty
from identification.registration.mount import Mount, given_mount, identify_mount
from identification.registration.readers import read_cloud
from identification.registration.surface import Surface, fit_surface
from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

MOST_CLOUD_POINTS = 2_000_000  # points of a cloud; larger ones are thinned, for time and memory
# times the cold noise: with a larger spread the warm points belong to another surface; by judgement
MOST_SPREAD_RATIO = 20.0


@dataclass(frozen=True)
class Registered:
    """Result of a registration.

    Attributes
    ----------
    table : DataFrame
        One row per artefact and WARM folder, in the columns of a survey: mm, rad, s.
    mount : Mount
    displacements : list of Displacement
        In the order of the rows.
    notes : tuple of str
    """

    table: pd.DataFrame
    mount: Mount
    displacements: list[Displacement]
    notes: tuple[str, ...]


def register(cold: Path, warm: Sequence[Path], profiler: Path, progress: Progress = silent) -> Registered:
    """Thermal error motions at every artefact, for every WARM folder.

    Parameters
    ----------
    cold, warm : Path, sequence of Path
        Folders with one cloud per artefact.
    profiler : Path
        ``profiler.yaml``.
    progress : Tell
        Progress callback.

    Raises
    ------
    InputError
        A file is missing or wrong, or clouds cannot be registered.
    """
    import pandas as pd

    point_cloud_library()  # before any work
    form, document = read_profiler(profiler)
    runs, times, notes = labels(warm), *_times(form, document, warm)
    count = len(form.positions)
    cold_files = clouds_in(cold, count)
    warm_files = [clouds_in(folder, count, cold_files) for folder in warm]
    with progress("Identifying the mount"):
        mount = _mount(form, document, profiler)
    lever = np.array(form.lever)
    rows: list[dict[str, float | str]] = []
    moved: list[Displacement] = []
    for k, position in enumerate(form.positions):
        with progress(f"Artefact {k + 1} of {count} at {form.joint} = {position:g}"):
            reference = _cloud(cold_files[k], form, mount)
            surface = fit_surface(reference)
            for run, files, time in zip(runs, warm_files, times, strict=True):
                found = _displacement(reference, surface, _cloud(files[k], form, mount), cold_files[k], files[k])
                moved.append(found)
                six, covariance = with_uncertainty(found.matrix, found.covariance, mount.six, mount.covariance, lever)
                u = np.sqrt(np.diag(covariance))
                row: dict[str, float | str] = {"joint": form.joint, form.joint: position, "run": run}
                row |= {} if time is None else {"time": time}
                row |= dict(zip(MOTIONS, six.tolist(), strict=True))
                row |= {f"u_{motion}": float(u[i]) for i, motion in enumerate(MOTIONS)}
                rows.append(row | {"rmse": found.rmse})
    by_run = np.argsort(np.tile(np.arange(len(runs)), count), kind="stable")
    table = pd.DataFrame(rows).iloc[by_run].reset_index(drop=True)
    return Registered(table, mount, [moved[i] for i in by_run], (*notes, *mount.notes))


def _times(form: Profiler, document: Document, warm: Sequence[Path]) -> tuple[list[float | None], tuple[str, ...]]:
    """Time (s) of each folder, as declared or from its name; None if one has no time."""
    if form.times is not None:
        if len(form.times) != len(warm):
            found = f"{len(form.times)} times for {len(warm)} WARM folders"
            raise document.error(("times",), found, "Write one a folder, in seconds and in the command's order")
        return list(form.times), ()
    found_times = [time_in(folder.absolute().name) for folder in warm]
    if None in found_times:
        silent_one = warm[found_times.index(None)]
        note = f"no time in the name '{silent_one.absolute().name}': the CSV has runs only; write times: [...] (s)"
        return [None] * len(warm), (f"{note} in {document.name}, or a unit in the folders' names, such as t_030min",)
    return found_times, ()


def _mount(form: Profiler, document: Document, profiler: Path) -> Mount:
    if form.mount is not None:
        return given_mount(form.mount)
    assert form.calibration is not None
    clouds: list[Array] = []
    for key in ("plane", "circle"):
        path = profiler.parent / getattr(form.calibration, key)
        if not path.is_file():
            beside = [p.name for p in path.parent.glob("*") if p.is_file()] if path.parent.is_dir() else []
            raise document.error(("calibration", key), f"no such file: {path}", nearest(path.name, beside, most=20))
        clouds.append(read_cloud(path, str(path), form.profile))
    return identify_mount(clouds[0], clouds[1], form.calibration, str(profiler.parent / form.calibration.circle))


def _cloud(path: Path, form: Profiler, mount: Mount) -> Array:
    points = read_cloud(path, str(path), form.profile)
    points = points[:: -(-len(points) // MOST_CLOUD_POINTS)]  # every k-th point of a larger cloud is accurate enough
    return clean(mount.in_sensor_frame(points), str(path))


def _displacement(cold: Array, surface: Surface, warm: Array, cold_file: Path, warm_file: Path) -> Displacement:
    """Displacement of a pair of clouds.

    Raises
    ------
    InputError
        The clouds do not overlap, differ in shape, one is mirrored, or not all six motions are identifiable.
    """
    found = displacement(cold, surface, warm)
    limit = MOST_SPREAD_RATIO * max(surface.sigma, 1e-6)
    if found is None or found.sigma > limit:
        mirrored = displacement(cold, surface, warm * np.array([1.0, 1.0, -1.0]))
        if mirrored is not None and mirrored.sigma < limit:
            cure = "Turn the sign of z in this scan, and look whether the sensor was mounted upside down"
            raise InputError(str(warm_file), f"upside down: mirrored in z it fits {cold_file}", cure)
    cure = f"Scan the same artefact at the same position as in {cold_file}, and give the same order in both folders"
    if found is None:
        raise InputError(str(warm_file), f"does not overlap with {cold_file}", cure)
    if found.sigma > limit:
        gap = f"{1e3 * found.sigma:.3g} um rms where its own noise is {1e3 * surface.sigma:.2g} um"
        raise InputError(str(warm_file), f"is not the surface of {cold_file}: {gap}", cure)
    if found.unseen:
        what = ", ".join(f"no {name}" for name in found.unseen)
        cure = "Use an artefact with relief in x and in y (a plane, a ridge or a ball does not show all six)"
        raise InputError(str(cold_file), f"its surface shows {what}", cure)
    return found
