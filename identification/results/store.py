"""A fit on disk: ``fit.json`` and the tables beside it."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel import __version__
from errormodel.arrays import Array
from errormodel.channels import root
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.files import write_csv, write_text_atomic
from errormodel.machine_file import write_machine
from errormodel.simulation import outward
from errormodel.survey import Survey
from errormodel.surveys.columns import OBSERVATION
from errormodel.surveys.observations import observed
from identification.estimation.fit import moved
from identification.estimation.motions import Motions
from identification.estimation.result import Fit, Streamed, noise_bounds
from identification.observation.pose import Pose
from identification.results import manifest
from identification.results.analysis import Analysis
from identification.results.correlations import correlations
from identification.results.json_text import dumps
from identification.results.results_folder import ResultsFolder, whole
from identification.results.set_ups import set_ups
from identification.results.stored_fit import SCHEMA, StoredFit, read_files
from identification.uncertainty.further_poses import leverages

if TYPE_CHECKING:
    import pandas as pd

PARAMETER_COLUMNS = (  # columns
    "id", "group", "symbol", "value", "std", "std_after_10_more", "std_after_10_best", "unit", "meaning",
)  # fmt: skip


def as_json(analysis: Analysis) -> dict[str, Any]:
    """``fit.json``: values and standard uncertainties in mm, rad and their ratios; residual statistics in um."""
    fit, gain = analysis.fit, analysis.gain
    s = fit.solution
    named = s.named()
    whole = None if s.dof <= 0 else s.chi2 / s.dof
    return {
        "schema": SCHEMA,
        "version": __version__,
        "machine": fit.chain.machine.name,
        "survey": fit.survey.name,
        "parameters": analysis.parameters,
        "location_errors": [e.as_json() for e in analysis.location_errors],
        "no_effect": list(s.groups.no_effect),
        "n_parameters": len(fit.chain.machine_ids),
        "rank": s.groups.rank,
        "condition": s.groups.condition,
        **analysis.stored.data,
        "frame_mode": fit.survey.frame,
        **({"inches": True} if fit.chain.machine.inches else {}),
        "frame": [
            {
                "label": label,
                "alignment": _pose_json(pose),
                "pose": _pose_json(moved(fit.chain, pose, named, label)),
            }
            for label, pose in fit.problem.frames.items()
        ],
        "nominal": asdict(fit.nominal),
        "fitted": asdict(fit.fitted),
        "heldout": asdict(fit.heldout) | {"blocks": fit.folds},
        "motions": [asdict(e) | {"unit": e.unit} for e in fit.motions.errors(fit.survey)] if fit.motions else [],
        "readings": [asdict(e) for e in fit.readings.errors(fit.survey)] if fit.readings else [],
        "observations": [v.as_json() for v in set_ups(fit)],
        "test": [
            {
                "path": t.path,
                "nominal": asdict(t.nominal),
                "fitted": asdict(t.fitted),
                "refit": t.refit,
                "frame": [{"label": label, "alignment": _pose_json(pose)} for label, pose in t.frames.items()],
            }
            for t in fit.tests
        ],
        "sigma_um": 1e3 * fit.sigma_mm,
        "sigma_interval_um": [1e3 * fit.sigma_mm * x for x in noise_bounds(s.dof)],
        "sigma_from": "declared" if "position" in fit.declared else "residuals",
        "noise": {kind: {"sigma": value, "declared": kind in fit.declared} for kind, value in s.sigma.items()},
        "dof": s.dof,
        "reduced_chi2": whole,
        "inflation": fit.inflation,
        "coverage": fit.coverage,
        "systematic_um": 1e3 * fit.systematic_mm,
        "systematic_by": fit.systematic_by,
        "other_effects": [asdict(other) for other in fit.others],
        "passes": s.passes,
        "converged": s.converged,
        "streamed": None if fit.streamed is None else _streamed_json(fit.streamed, len(fit.survey)),
        "budget": analysis.budgets.as_json(),
        "posterior": fit.posterior.as_json() if fit.posterior else None,
        "notes": list(fit.notes),
        "test_record": None if fit.survey.record is None else fit.survey.record.model_dump(exclude_defaults=True),
        "at_bound": [asdict(b) for b in fit.at_bound],
        "robust": fit.sorting is not None,
        "outliers": [o.as_json() for o in fit.outliers],
        "correlations": correlations(fit),
        "next_poses": [] if gain.poses is None else gain.poses.to_dict("records"),
    }


def _streamed_json(streamed: Streamed, sample: int) -> dict[str, Any]:
    """What `fit --stream` says of its rows; no times, since the same input gives the same bytes."""
    kept = {"rows": streamed.rows, "sample": sample, "passes": streamed.passes, "files": dict(streamed.files)}
    return kept | {"last_step_um": 1e3 * streamed.moved_mm}


def save(fit: Fit, folder: Path) -> None:
    """Write the results of a fit with their manifest to `folder`, all or nothing.

    Raises
    ------
    InputError
        The folder holds files that errormodel did not write, or cannot be written.
    """
    with ResultsFolder(folder).replaced() as part:
        write(Analysis(fit), part)


def write(analysis: Analysis, folder: Path) -> None:
    """Write machine, ``parameters.csv``, ``residuals.csv``, ``covariance.csv`` and ``fit.json`` to an empty folder."""
    import pandas as pd

    fit = analysis.fit
    write_machine(fit.chain.machine, folder / "machine.yaml")
    table = pd.DataFrame(analysis.parameters, columns=list(PARAMETER_COLUMNS))
    write_csv(table, folder / "parameters.csv")
    write_csv(residual_table(fit), folder / "residuals.csv")
    names = [fit.solution.unknowns[j] for j in fit.solution.groups.base]
    covariance = pd.DataFrame(fit.solution.covariance * fit.inflation**2, columns=names)
    write_csv(covariance, folder / "covariance.csv")
    write_text_atomic(dumps(as_json(analysis)), folder / "fit.json")


def _pose_json(pose: Pose) -> dict[str, list[float]]:
    """Translation (mm) and rotation vector (rad) from reference to measuring frame, and undetermined axes."""
    from scipy.spatial.transform import Rotation

    return {
        "translation": pose.translation.tolist(),
        "rotation": Rotation.from_matrix(pose.rotation).as_rotvec().tolist(),
    } | ({"undetermined": pose.undetermined.tolist()} if len(pose.undetermined) else {})


def residual_table(fit: Fit) -> pd.DataFrame:
    """Nominal, fitted and held-out residual of every measured row, um, in the measuring frame."""
    import pandas as pd

    whole = fit.sorting or fit  # the fit that includes outliers, which have residuals too
    parts: list[tuple[Survey, Array, Array, Array | None]] = [
        (fit.survey, whole.nominal_residuals, whole.residuals, fit.heldout_residuals)
    ]
    parts += [(t.survey, t.nominal_residuals, t.residuals, None) for t in fit.tests]
    tables = []
    for survey, nominal, fitted, heldout in parts:
        table = outward(survey.table, fit.chain.machine)
        wanted = ("file", "role", "row", "run", "time", "joint", *fit.chain.channels, *map(root, fit.chain.channels))
        table = table[[c for c in dict.fromkeys(wanted) if c in table]].copy()
        for name, values in (("nominal", nominal), ("residual", fitted), ("heldout", heldout)):
            if values is not None:
                table[[f"{name}_{axis}_um" for axis in "xyz"]] = 1e3 * values
        tables.append(table)
    if fit.motions is not None:
        tables[0] = tables[0].join(_motion_columns(fit.motions))
    if fit.readings is not None:
        tables[0] = tables[0].join(_reading_columns(fit))
    tables[0]["leverage"] = leverages(fit)
    if fit.sorting is not None:
        tables[0]["distance_sigma"], tables[0]["weight"] = fit.sorting.distance, fit.sorting.weight
        words: list[list[str]] = [[] for _ in range(len(tables[0]))]
        for o in fit.outliers:
            words[o.index].append(o.what)
        tables[0]["outlier"] = [" ".join(own) for own in words]
    return pd.concat(tables, ignore_index=True)


def _motion_columns(motions: Motions) -> Any:
    """Columns of measured error motions, um and urad: ``nominal_dx_um``, ``heldout_eb_urad``."""
    import pandas as pd

    columns = {}
    for name, values in (("nominal", motions.nominal), ("residual", motions.fitted), ("heldout", motions.heldout)):
        for k, motion in enumerate(MOTIONS):
            if np.isfinite(motions.nominal[:, k]).any():
                factor, unit = (1e3, "um") if motion in TRANSLATIONS else (1e6, "urad")
                columns[f"{name}_{motion}_{unit}"] = factor * values[:, k]
    return pd.DataFrame(columns)


def _reading_columns(fit: Fit) -> Any:
    """Columns of single readings, um and urad: ``observation``, ``nominal_length_um``, ``heldout_angle_urad``."""
    import pandas as pd

    assert fit.readings is not None
    names, r = observed(fit.survey.table), fit.readings
    columns: dict[str, Any] = {OBSERVATION: names}
    for reading, factor, unit in (("length", 1e3, "um"), ("angle", 1e6, "urad")):
        labels = [label for label, o in fit.survey.observations.items() if o.reading == reading]
        own = np.isin(names, labels)
        if own.any():
            for name, values in (("nominal", r.nominal), ("residual", r.fitted), ("heldout", r.heldout)):
                columns[f"{name}_{reading}_{unit}"] = np.where(own, factor * values, np.nan)
    return pd.DataFrame(columns)


def load(folder: Path) -> StoredFit:
    """Read a fit from its folder.

    Raises
    ------
    InputError
        The folder holds no finished fit, or its files do not belong together.
    """
    with whole(folder):
        return replace(read_files(folder), unlisted=manifest.missing(folder))
