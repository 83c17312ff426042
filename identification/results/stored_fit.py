"""What prediction, compensation and monitoring need of a fit, and how it is read from the folder of the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.files import read_csv
from errormodel.inputs import noted
from errormodel.machine_file import read_machine
from identification.estimation.result import Fit, Spread
from identification.observation.open_signs import OPEN_SIGNS, sign_notes
from identification.observation.pose import Pose
from identification.results.set_ups import set_ups
from identification.results.versions import read_json
from identification.uncertainty.measured_range import covered
from identification.uncertainty.one_side import only_sides
from identification.uncertainty.other_effects import OtherEffect
from identification.uncertainty.recording_end import runs_of, temperatures_of
from identification.uncertainty.rows_in_time import temperature_noise
from identification.uncertainty.unmeasured_components import unmeasured

if TYPE_CHECKING:
    import pandas as pd

Axes = Literal["measured", "machine"]
SCHEMA = "errormodel.fit/1"
CURE = "Give the folder that `errormodel fit ... --out DIR` wrote"
CORRELATION_MARGIN = 1e-6  # rounding errors of a covariance, relative; far above those of a product of matrices


@dataclass(frozen=True)
class StoredFit:
    """What `predict` and `compensate` need of a fit: the chain, values, covariance and frames."""

    chain: Chain
    values: dict[str, float]
    base: tuple[str, ...]
    covariance: Array  # of `base`
    units: dict[str, str]
    groups: dict[str, dict[str, float]]  # members of each group and their coefficients
    frame_mode: str  # which rows of a survey share a measuring frame
    frames: dict[str, Pose]  # alignments, which the small frame parameters follow
    test_frames: dict[str, dict[str, Pose]]  # the same for each test file
    data: dict[str, Any]
    set_ups: dict[str, float] = field(default_factory=dict)  # unknown numbers of observations, mm and rad
    free_reference: bool = False  # only readings were fitted, which do not show where the machine stands
    coverage: float = 1.0  # factor on standard uncertainties of predictions, for noise from few degrees of freedom
    systematic: float = 0.0  # mm of a coordinate, in the residuals, beyond the noise
    others: tuple[OtherEffect, ...] = ()  # what the recording leaves open of effects
    unlisted: tuple[str, ...] = ()  # what is said of a folder whose files cannot be checked
    error_axes: Axes = "measured"  # of predicted errors: those of the measuring frame, or x y z of ``machine.yaml``

    @property
    def fitted(self) -> Spread:
        return Spread(**self.data["fitted"])

    def with_effect(self, other: OtherEffect) -> StoredFit:
        """The fit with another effect, and what else was fitted with it."""
        return replace(self, chain=Chain(other.machine(self.chain.machine)), values=dict(other.parameters), others=())

    def others_for(self, table: pd.DataFrame) -> list[OtherEffect]:
        """What the recording leaves open of effects, as far as rows have the columns for it."""
        return [other for other in self.others if not other.missing(self.chain.machine, table)]

    @property
    def sign_notes(self) -> tuple[str, ...]:
        """What every use says where the sign of what was measured cannot be known."""
        return (OPEN_SIGNS,) if self.data.get("open_signs") else ()

    @property
    def widened(self) -> Array:
        """The covariance of `base`, of which two standard uncertainties cover 95.45 %."""
        return self.covariance * self.coverage**2


def recorded(fit: Fit) -> dict[str, Any]:
    """What later predictions need to know of the recording: ranges, and the state in which it ended."""
    zero, machine = fit.survey.clock_zero, fit.chain.machine
    models = [fit.chain.channels, *(other.channels(machine) for other in fit.others)]
    return {
        **({} if zero is None else {"clock_zero": str(np.datetime64(round(zero * 1e6), "us"))}),
        "covered": covered(fit.chain, fit.span),
        "only_sides": only_sides(fit),
        "temperatures": temperatures_of(models, fit.span),
        "temperature_noise": temperature_noise(models, fit.span),
        "runs": runs_of(fit.chain, fit.span),
        **({"unmeasured": missing} if (missing := unmeasured(fit)) else {}),
        **({} if fit.expansions is None else {"expansions": fit.expansions}),
        **({"open_signs": True} if sign_notes(fit.problem.views, fit.survey.indicated) else {}),
    }


def stored(fit: Fit, groups: Sequence[Mapping[str, Any]]) -> StoredFit:
    """The fit with its `groups` (see `groups_of`) as its folder would give it; its data is what was recorded."""
    return StoredFit(
        chain=fit.chain,
        values={p["id"]: p["value"] for p in groups},
        base=tuple(p["id"] for p in groups),
        covariance=fit.solution.covariance * fit.inflation**2,
        units={p["id"]: p["unit"] for p in groups},
        groups={p["id"]: p["members"] for p in groups},
        frame_mode=fit.survey.frame,
        frames=fit.problem.frames,
        test_frames={t.path: t.frames for t in fit.tests},
        data=recorded(fit),
        set_ups={v.id: v.value for v in set_ups(fit)},
        free_reference=bool(fit.problem.readings) and not fit.problem.frames and fit.survey.frame != "fixed",
        coverage=fit.coverage,
        systematic=fit.systematic_mm,
        others=fit.others,
    )


def read_files(folder: Path) -> StoredFit:
    """Read the files of a fit: without the manifest and the lock of `identification.results.store.load`."""
    from identification.results.fit_file import check_fit, check_parameters

    path = noted(folder / "fit.json")
    try:
        data = read_json(path, SCHEMA, CURE)
        check_fit(path, data)
        entries = data["parameters"]
        base = tuple(str(p["id"]) for p in entries)
        chain = _machine_of(folder, base)
        check_parameters(path, data, chain)
        fit = StoredFit(
            chain,
            {p["id"]: float(p["value"]) for p in entries},
            base,
            _covariance(folder, base, np.array([p["std"] for p in entries], dtype=float)),
            {p["id"]: str(p["unit"]) for p in entries},
            {p["id"]: {str(m): float(c) for m, c in p["members"].items()} for p in entries},
            str(data["frame_mode"]),
            _poses(data["frame"]),
            {str(t["path"]): _poses(t.get("frame", [])) for t in data["test"]},
            data,
            {str(v["id"]): float(v["value"]) for v in data.get("observations", [])},
            bool(data.get("readings")) and not data["frame"] and data["frame_mode"] != "fixed",
            float(data.get("coverage", 1.0)),
            1e-3 * float(data.get("systematic_um", 0.0)),
            tuple(
                OtherEffect(o["effect"], o["options"], float(o["weight"]), o["parameters"], o.get("name", ""))
                for o in data.get("other_effects", [])
            ),
        )
    except OSError as error:
        raise InputError(str(path), f"it cannot be read ({error.strerror})", CURE) from error
    return fit


def _poses(entries: list[dict[str, Any]]) -> dict[str, Pose]:
    """Alignments by label, as `_pose_json` wrote them."""
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
        if identity not in chain.index and not identity.startswith(("frame[", "zero[", "observation[")):
            found = f"the machine has no parameter '{identity}', which fit.json estimates"
            raise InputError(str(path), found, "Run the fit again")
    return chain


def _covariance(folder: Path, base: tuple[str, ...], std: Array) -> Array:
    path = noted(folder / "covariance.csv")
    if not base:  # a table without columns is an empty file
        return np.zeros((0, 0))
    try:
        table = read_csv(path)
        matrix = table.to_numpy(dtype=float)
    except (OSError, ValueError) as error:
        found = f"it cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InputError(str(path), found, "Run the fit again") from error
    ours = tuple(table.columns) == base and len(matrix) == len(base)
    if not ours or not np.allclose(np.diag(matrix), std**2, rtol=1e-9, atol=0.0):
        raise InputError(str(path), "it is of another fit than fit.json", "Run the fit again")
    bound = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix))) * (1 + CORRELATION_MARGIN)
    if not (np.abs(matrix) <= bound).all() or not (np.abs(matrix - matrix.T) <= CORRELATION_MARGIN * bound).all():
        found = "it is no covariance matrix: not symmetric, or with correlations beyond 1"
        raise InputError(str(path), found, "Run the fit again")
    return matrix
