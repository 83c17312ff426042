"""Which rows of an import share a measuring frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.file import Frame
from identification.diagnosis.data_checks.steps import large_steps
from identification.importing.sources import SourceFile
from identification.observation.frames import MACHINE_ERROR_SHARE, align

SAME_FRAME = 3.0  # times the misfit of the better file alone: so far may two files in one frame be off; by judgement


def frame_of(
    points: Sequence[SourceFile], aligned: Sequence[tuple[Array, Array]], chain: Chain, said: Frame | Literal[""]
) -> Frame:
    """Which rows share a measuring frame: what the user `said`, or all, those of a station in one file, or of a file.

    Parameters
    ----------
    aligned : nominal and measured points (n, 3) of each file, mm.
    said : as in survey.yaml; empty: found.

    Raises
    ------
    InputError
        A frame a run, and no file with a column of runs.
    """
    if said == "per-run" and not any({"run", "station"} & {*s.recording.frame} for s in points):
        cure = "Give the table a column run, or name the one it has: --columns run=.."
        raise InputError("--frame per-run", "no file has a column of runs or stations", cure)
    if said:
        return said
    if any("station" in s.recording.frame and s.recording.frame["station"].nunique() > 1 for s in points):
        return "per-run"
    if len(points) < 2:
        return "shared"
    if any(not np.isfinite(m).all() or len(m) < 4 for _, m in aligned):
        return "shared"
    alone = max(_miss(n, m) for n, m in aligned)
    together = _miss(np.vstack([n for n, _ in aligned]), np.vstack([m for _, m in aligned]))
    return "per-file" if together > SAME_FRAME * max(alone, MACHINE_ERROR_SHARE * chain.size) else "shared"


def _miss(nominal: Array, measured: Array) -> float:
    return float(np.quantile(np.linalg.norm(measured - align(nominal, measured).apply(nominal), axis=1), 0.8))


def parted_by_runs(machine: Machine, survey: Survey) -> bool:
    """Whether points in one frame are displaced, further than an effect describes, where a run begins."""
    run, file, row = (survey.table[name].to_numpy() for name in ("run", "file", "row"))
    if len(np.unique(run.astype(str))) < 2:
        return False
    steps = large_steps(machine, survey)
    here = [int(np.flatnonzero((file == s.file) & (row == s.row))[0]) for s in steps]
    return bool(here) and all(k > 0 and run[k] not in run[:k][file[:k] == file[k]] for k in here)
