"""Fit files: writing ``fit.json`` and its tables, and reading back what prediction and compensation need."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel import __version__
from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import root
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.exceptions import InputError
from errormodel.files import write_csv, write_text_atomic
from errormodel.inputs import noted
from errormodel.location_errors import named
from errormodel.machine_file import read_machine, write_machine
from errormodel.simulation import outward
from errormodel.survey import Survey
from identification.estimation.motions import Motions
from identification.estimation.result import Fit, Spread
from identification.estimation.run import moved
from identification.observation.frames import Pose
from identification.results.results_folder import ResultsFolder, whole
from identification.uncertainty.further_poses import leverages
from identification.uncertainty.measured_range import covered

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "errormodel.fit/1"
PARAMETER_COLUMNS = (  # columns
    "id", "group", "symbol", "value", "std", "std_after_10_more", "std_after_10_best", "unit", "meaning",
)  # fmt: skip
CURE = "Give the folder that `errormodel fit ... --out DIR` wrote"


def as_json(fit: Fit) -> dict[str, Any]:
    """Content of ``fit.json``: values and standard uncertainties in mm, rad and ratios; residual statistics in um."""
    s = fit.solution
    named = s.named()
    whole = None if s.dof <= 0 else s.chi2 / s.dof
    return {
        "schema": SCHEMA,
        "version": __version__,
        "machine": fit.chain.machine.name,
        "survey": str(fit.survey.source),
        "parameters": parameters(fit),
        "no_effect": list(s.groups.no_effect),
        "n_parameters": len(fit.chain.machine_ids),
        "rank": s.groups.rank,
        "condition": s.groups.condition,
        "covered": covered(fit.chain, fit.survey.table),
        "frame_mode": fit.survey.frame,
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
        "sigma_from": "declared" if "position" in s.declared else "residuals",
        "noise": {kind: {"sigma": value, "declared": kind in s.declared} for kind, value in s.sigma.items()},
        "dof": s.dof,
        "reduced_chi2": whole,
        "inflation": fit.inflation,
        "passes": s.passes,
        "converged": s.converged,
        "budget": fit.budgets.as_json(),
        "posterior": fit.posterior.as_json() if fit.posterior else None,
        "notes": list(fit.notes),
        "at_bound": [asdict(b) for b in fit.at_bound],
        "robust": fit.sorting is not None,
        "outliers": [o.as_json() for o in fit.outliers],
        "correlations": correlations(fit),
        "next_poses": [] if fit.gain.poses is None else fit.gain.poses.to_dict("records"),
    }


def parameters(fit: Fit) -> list[dict[str, Any]]:
    """One entry per group: id of the base parameter, formula, value, standard uncertainty, unit."""
    s, chain = fit.solution, fit.chain
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    best = fit.gain.best
    out = []
    for k, j in enumerate(s.groups.base):
        name = s.unknowns[j]
        plain = "frame." + name.rsplit(".", 1)[1] if name.startswith("frame[") else name
        known = chain.parameters[chain.index[plain]] if plain in chain.index else None
        motion = name.rsplit(".", 1)[1]
        members = s.groups.members(k)
        location = named(chain.location_errors, members)
        out.append(
            {
                "id": name,
                "group": s.groups.name(k),
                "members": members,
                "symbol": location.symbol if location else known.symbol if known else "",
                "meaning": location.words if location else "",
                "value": float(s.values[j]),
                "std": float(std[k]),
                "std_after_10_more": float(fit.gain.like_these[k]),
                "std_after_10_best": None if best is None else float(best[k]),
                "unit": known.unit if known else ("mm" if motion in ("dx", "dy", "dz") else "rad"),
            }
        )
    return out


def correlations(fit: Fit, least: float = 0.9, most: int = 100) -> list[dict[str, Any]]:
    """Most strongly correlated pairs of groups; all correlations follow from ``covariance.csv``."""
    s = fit.solution
    std = np.sqrt(np.diag(s.covariance))
    matrix = np.triu(s.covariance / np.outer(std, std), 1)
    pairs = np.argwhere(np.abs(matrix) > least)
    order = np.argsort(-np.abs(matrix[tuple(pairs.T)]), kind="stable")[:most]
    names = [s.unknowns[j] for j in s.groups.base]
    return [{"groups": [names[i], names[j]], "correlation": float(matrix[i, j])} for i, j in pairs[order]]


def save(fit: Fit, folder: Path) -> None:
    """Write the results of a fit with their manifest to `folder`, all or nothing.

    Raises
    ------
    InputError
        The folder holds files that errormodel did not write, or cannot be written.
    """
    with ResultsFolder(folder).replaced() as part:
        write(fit, part)


def write(fit: Fit, folder: Path) -> None:
    """Write machine, ``parameters.csv``, ``residuals.csv``, ``covariance.csv`` and ``fit.json`` to an empty folder."""
    import pandas as pd

    write_machine(fit.chain.machine, folder / "machine.yaml")
    table = pd.DataFrame(parameters(fit), columns=list(PARAMETER_COLUMNS))
    write_csv(table, folder / "parameters.csv")
    write_csv(residual_table(fit), folder / "residuals.csv")
    names = [fit.solution.unknowns[j] for j in fit.solution.groups.base]
    covariance = pd.DataFrame(fit.solution.covariance * fit.inflation**2, columns=names)
    write_csv(covariance, folder / "covariance.csv")
    write_text_atomic(dumps(as_json(fit)), folder / "fit.json")


def dumps(data: Any) -> str:
    """JSON text with NaN as null, which every reader accepts."""
    return json.dumps(_plain(data), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value


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


@dataclass(frozen=True)
class StoredFit:
    """Part of a fit that prediction and compensation need: chain, values, covariance and frames."""

    chain: Chain
    values: dict[str, float]
    base: tuple[str, ...]
    covariance: Array  # of the parameters `base`, in products of their units
    units: dict[str, str]
    groups: dict[str, dict[str, float]]  # members of each group and their coefficients
    frame_mode: str  # rows that share a measuring frame
    frames: dict[str, Pose]  # alignments by label; the small frame parameters are relative to them
    test_frames: dict[str, dict[str, Pose]]  # the same for each test file
    data: dict[str, Any]

    @property
    def fitted(self) -> Spread:
        return Spread(**self.data["fitted"])


def stored(fit: Fit) -> StoredFit:
    """The fit as read back from its folder, without residual statistics."""
    entries = parameters(fit)
    return StoredFit(
        chain=fit.chain,
        values={p["id"]: p["value"] for p in entries},
        base=tuple(p["id"] for p in entries),
        covariance=fit.solution.covariance * fit.inflation**2,
        units={p["id"]: p["unit"] for p in entries},
        groups={p["id"]: p["members"] for p in entries},
        frame_mode=fit.survey.frame,
        frames=fit.problem.frames,
        test_frames={t.path: t.frames for t in fit.tests},
        data={},
    )


def load(folder: Path) -> StoredFit:
    """Read a fit from its folder.

    Raises
    ------
    InputError
        The folder holds no finished fit, or its files do not belong together.
    """
    with whole(folder):
        return read_files(folder)


def read_files(folder: Path) -> StoredFit:
    """Read a fit without checking the manifest and without a lock."""
    path = noted(folder / "fit.json")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise InputError(str(path), f"its schema is {data['schema']!r}, not {SCHEMA!r}", CURE)
        entries = data["parameters"]
        base = tuple(str(p["id"]) for p in entries)
        fit = StoredFit(
            _machine_of(folder, base),
            {p["id"]: float(p["value"]) for p in entries},
            base,
            _covariance(folder, base, np.array([p["std"] for p in entries], dtype=float)),
            {p["id"]: str(p["unit"]) for p in entries},
            {p["id"]: {str(m): float(c) for m, c in p["members"].items()} for p in entries},
            str(data["frame_mode"]),
            _poses(data["frame"]),
            {str(t["path"]): _poses(t.get("frame", [])) for t in data["test"]},
            data,
        )
    except OSError as error:
        raise InputError(str(path), f"it cannot be read ({error.strerror})", CURE) from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(str(path), f"it cannot be read as a fit ({type(error).__name__}: {error})", CURE) from error
    return fit


def _poses(entries: list[dict[str, Any]]) -> dict[str, Pose]:
    """Alignments by label, from the JSON of `_pose_json`."""
    from scipy.spatial.transform import Rotation

    return {
        str(f["label"]): Pose(
            Rotation.from_rotvec(f["alignment"]["rotation"]).as_matrix(),
            np.array(f["alignment"]["translation"], dtype=float),
            np.array(f["alignment"].get("undetermined", []), dtype=float).reshape(-1, 3),
        )
        for f in entries
    }


def _machine_of(folder: Path, base: tuple[str, ...]) -> Chain:
    path = folder / "machine.yaml"
    if not path.is_file():
        raise InputError(str(path), "there is no such file", CURE)
    chain = Chain(read_machine(path))
    for identity in base:
        if identity not in chain.index and not identity.startswith(("frame[", "zero[")):
            found = f"the machine has no parameter '{identity}', which fit.json estimates"
            raise InputError(str(path), found, "Run the fit again")
    return chain


def _covariance(folder: Path, base: tuple[str, ...], std: Array) -> Array:
    import pandas as pd

    path = noted(folder / "covariance.csv")
    try:
        table = pd.read_csv(path)
        matrix = table.to_numpy(dtype=float)
    except (OSError, ValueError) as error:
        found = f"it cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InputError(str(path), found, "Run the fit again") from error
    ours = tuple(table.columns) == base and len(matrix) == len(base)
    if not ours or not np.allclose(np.diag(matrix), std**2, rtol=1e-9, atol=0.0):
        raise InputError(str(path), "it is of another fit than fit.json", "Run the fit again")
    return matrix
