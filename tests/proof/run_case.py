"""The tool on one case, through the functions that its commands use (or through the commands themselves)."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

from tests.proof.leave_out import left_out
from tests.proof.seal import digest, write_atomic

# outcomes of decisions that changed nothing
UNDECIDED = ("passed", "not considered", "scored", "compared", "kept", "accepted")


def run_case(folder: Path, out: Path, through_cli: bool = False, without: str = "") -> None:
    """Diagnose and predict, without one of the rules if it is named; write ``<case>.json`` with what the tool says.

    Sees the case's own folder only. ``rules`` in the result: those that decided something. The seconds that it took
    are a file of their own, so that a proof that was broken off ends with the same results.
    """
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with left_out(without):
                result = _commands(folder) if through_cli else _functions(folder)
    except Exception:  # noqa: BLE001  what breaks is a result too
        result = {"error": traceback.format_exc()}
    write_atomic(seconds_file(out, folder.name), repr(time.perf_counter() - start))
    result["input"] = digest(folder)
    write_atomic(out / f"{folder.name}.json", json.dumps(result))


def seconds_file(out: Path, case: str) -> Path:
    """Where the seconds that a case took are written, beside its result."""
    return out / "seconds" / case


def _survey(folder: Path) -> Path:
    declared = folder / "survey.yaml"
    return declared if declared.exists() else folder / "survey.csv"


def _functions(folder: Path) -> dict[str, Any]:
    from errormodel.machine_file import read_machine
    from errormodel.survey import read_survey
    from identification.diagnosis.pipeline import diagnose
    from identification.results import store
    from identification.uncertainty.prediction import predict

    machine = read_machine(folder / "machine.yaml")
    found = diagnose(machine, read_survey(_survey(folder), machine))
    acted = {d.rule for d in found.log if d.outcome not in UNDECIDED}
    out: dict[str, Any] = {"diagnosis": found.diagnosis.as_json(), "rules": sorted(acted)}
    for name, fit in (("final", found.final), ("plain", found.baseline)):
        with tempfile.TemporaryDirectory() as scratch:
            store.save(fit, Path(scratch))
            stored = store.load(Path(scratch))
            points = read_survey(folder / "heldout.csv", stored.chain.machine, measured=False)
            table = predict(stored, points)
        out[name] = table[["mx", "my", "mz", "ux", "uy", "uz"]].to_numpy().tolist()
    return out


def _commands(folder: Path) -> dict[str, Any]:
    import csv

    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        for command in ("diagnose", "fit"):
            _command(command, folder / "machine.yaml", _survey(folder), "--out", scratch / command)
            where = scratch / f"{command}.csv"
            _command("predict", scratch / command, folder / "heldout.csv", "--out", where)
        out: dict[str, Any] = {"diagnosis": json.loads((scratch / "diagnose" / "diagnosis.json").read_text())}
        for key, command in (("final", "diagnose"), ("plain", "fit")):
            with (scratch / f"{command}.csv").open(newline="") as stream:
                rows = list(csv.DictReader(stream))
            out[key] = [[float(r[c]) for c in ("mx", "my", "mz", "ux", "uy", "uz")] for r in rows]
    return out


def _command(*words: object) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "identification.command_line.main", *map(str, words), "--quiet"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{words[0]}: {done.stderr[-2000:]}")
