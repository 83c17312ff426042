"""A command on every survey of a fleet, and what only the whole fleet can tell."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from identification.api.models import diagnose, fit
from identification.api.standards import iso
from identification.api.uses import load, monitor
from identification.runtime.progress import Progress, Steps, silent, uncounted

if TYPE_CHECKING:
    from identification.fleets.parts import Failure, Made, Opened, Task
    from identification.results.fit_result import FitResult
    from identification.results.fleet_result import FleetResult
    from identification.results.results_folder import ResultsFolder
    from identification.runtime.engines import Engine

Command = Literal["fit", "diagnose", "monitor", "iso"]


def fleet(
    listing: str | Path,
    out: str | Path | ResultsFolder,
    *,
    command: Command = "fit",
    engine: Engine = "local",
    scheduler: str | None = None,
    workers: int | None = 1,
    rate: float = 0.01,
    standard: str = "all",
    reports: bool = False,
    announce: Callable[[str], None] = lambda _text: None,
    warn: Callable[[str], None] = lambda _text: None,
    progress: Progress = silent,
    steps: Steps = uncounted,
) -> FleetResult:
    """Run a command on every survey of a fleet, and compare the machines of each type with one another.

    Parts that an earlier run finished in `out`, whole and of the same inputs, are taken up again. Results do not depend
    on the engine nor on the number of workers.

    Parameters
    ----------
    listing : str or Path
        CSV or Parquet file with the columns ``machine`` and ``survey`` (paths relative to it, or addresses that fsspec
        knows), and if wanted ``id`` (of the machine), ``type``, ``date`` and others, which are labels.
    out : str, Path or ResultsFolder
        Folder for the results; its subfolder ``parts`` holds those of each survey.
    command : {"fit", "diagnose", "monitor", "iso"}
        With ``monitor``, `machine` is the folder of a fit, and the surveys of a machine are its cycles by date.
    engine : {"local", "dask"}
    scheduler : str or None
        Address of a Dask scheduler; None: a cluster on this computer.
    workers : int or None
        Processes; None: one a core. With "local" and 1, this process does it; with more, a script that calls this needs
        ``if __name__ == "__main__":``, as workers import it.
    rate : float
        Largest share of false ones among the machines that are called out, at 95 % confidence; between 0 and 0.5.
    standard : str
        Of ``iso``: names of `standards`, or ``all``.
    reports : bool
        Write the report of each part, too.
    announce : callable
        Called with a sentence for the user, such as the address of Dask's dashboard.
    warn : callable
        Called with the first failure of each kind as it happens.
    progress, steps : callable
        Called with the name of each long part, and of work that knows how far it is; return context managers.

    Returns
    -------
    FleetResult
        ``machines``, ``surveys``, ``parameters``, ``findings``, ``normal``, ``common``, ``failures`` (DataFrames),
        ``summary()``, ``save``.

    Raises
    ------
    InputError
        The list or an option is wrong, or the folder may not be written. Surveys that fail stand in ``failures``.
    """
    from errormodel.exceptions import InputError, nearest
    from errormodel.extras import optional
    from errormodel.files import forget
    from errormodel.inputs import Run, current, running
    from identification.fleets.run import run_fleet
    from identification.results.folder_contents import FAILURES, PARTS
    from identification.results.results_folder import ResultsFolder
    from identification.runtime.engines import Crew

    if command not in WORK:
        raise InputError("--command", f"'{command}'", nearest(command, WORK))
    if not 0 < rate < 0.5:
        raise InputError("--rate", f"{rate:g}", "Write a share of machines between 0 and 0.5, such as 0.01")
    optional("pyarrow", str(listing), "the tables of a fleet are written as Parquet")
    crew = Crew(engine, workers, scheduler, announce)
    crew.check()
    if command == "iso" and standard != "all":
        from identification.iso_standards import standards as named

        named(standard)
    folder = out if isinstance(out, ResultsFolder) else ResultsFolder(Path(out), "fleet")

    def done() -> FleetResult:
        result = run_fleet(listing, folder, command, crew, work, rate, standard, reports, warn, steps)
        result.save(folder, progress=progress)
        forget(folder.path / PARTS / FAILURES)  # the table of the whole fleet has them
        return result

    if current() is not None:
        return done()
    given = {"command": command, "rate": rate, "standard": standard, "reports": reports}
    with running(Run("fleet", {"listing": Path(listing).name}, given, [folder])):
        return done()


def work(task: Task) -> Made | Failure:
    """Make one part: what a worker does, in whatever process."""
    from errormodel.inputs import Run, running
    from identification.fleets.parts import Made, Opened, failure_of, record_of
    from identification.runtime.parallel import one_core

    opened: Opened | None = None
    try:
        with one_core(), Opened(task) as opened, tempfile.TemporaryDirectory(prefix="errormodel-") as space:
            run, folder = Run("fleet", None, {}, ()), Path(space) / "part"
            with running(run):
                kind, surveys = WORK[task.command](opened, folder)
            own = Path(space).resolve()  # what it wrote itself and read again
            sources = opened.sources({p: d for p, d in run.inputs.items() if not p.is_relative_to(own)})
            files = {
                p.relative_to(folder).as_posix(): p.read_bytes()
                for p in sorted(folder.rglob("*"))
                if p.is_file() and p.name != "manifest.json"
            }
            return Made(files, sources, record_of(task, opened, sources, surveys, kind))
    except Exception as error:  # noqa: BLE001  whatever happens to one survey, the others go on
        return failure_of(opened, error)


Worked = tuple[str, list[dict[str, Any]]]


def _fit(opened: Opened, folder: Path) -> Worked:
    return _fitted(fit(opened.machine, opened.surveys[0]), opened, folder)


def _diagnose(opened: Opened, folder: Path) -> Worked:
    result = diagnose(opened.machine, opened.surveys[0])
    found = result.diagnosed.diagnosis.as_json()
    return _fitted(result, opened, folder, {"verdict": result.verdict, "findings": found["findings"]})


def _fitted(result: FitResult, opened: Opened, folder: Path, more: Mapping[str, Any] | None = None) -> Worked:
    from identification.fleets.estimates import of_fit

    result.save(folder, report=opened.task.options.reports)
    stored = load(folder).stored
    entry = {
        "rows": len(result.fit.survey),
        "rms_um": result.fit.fitted.rms_um,
        "heldout_um": result.fit.heldout.rms_um,
        "noise_um": result.sigma_um,
        "notes": list(result.notes),
        "estimates": of_fit(result.fit, stored).as_json(),
    }
    return result.machine.name, [entry | dict(more or {})]


def _monitor(opened: Opened, folder: Path) -> Worked:
    """All cycles of a machine on a copy of its fit, whose own history stays as it is."""
    from errormodel.exceptions import InputError
    from errormodel.inputs import noted
    from identification.fleets.collecting import ALARM
    from identification.fleets.estimates import Estimates, without_moves
    from identification.fleets.parts import failure_of

    place = opened.machine
    if isinstance(place, str) or not place.is_dir():
        found = "no folder of a fit, which `monitor` compares cycles with"
        raise InputError(str(place), found, "Write the folder that `errormodel fit ... --out DIR` wrote")
    for path in sorted(p for p in place.rglob("*") if p.is_file()):
        noted(path)
    copy = folder.with_name("fit") / place.name
    shutil.copytree(place, copy)
    entries: list[dict[str, Any]] = []
    task = opened.task
    name = ""
    for survey in opened.surveys:
        try:
            result = monitor(copy, survey, rate=task.options.rate, report=True)
        except InputError as error:  # a cycle that cannot be read stops no other
            if len(entries) == len(opened.surveys) - 1 and not name:
                raise  # there is no other
            entries.append({"failure": asdict(failure_of(opened, error))})
            continue
        done = result.monitored
        name = done.stored.chain.machine.name
        entries.append(
            {
                "verdict": result.status,
                "notes": [],
                "findings": [
                    {"effect": ALARM, "where": str(a["kind"]), "statement": a["statement"]}
                    for a in done.alarms
                ],
                "estimates": Estimates(
                    done.what, done.record.cycle.values, done.record.cycle.covariance, without_moves(done.what)
                ).as_json(),
            }
        )  # fmt: skip
    folder.mkdir()
    for made in ("monitor.json", *(["monitor.html"] if task.options.reports else [])):
        shutil.copyfile(copy / made, folder / made)
    return name, entries


def _iso(opened: Opened, folder: Path) -> Worked:
    from errormodel.files import write_csv, write_text_atomic
    from identification.fleets.estimates import of_evaluation
    from identification.results.json_text import dumps

    result = iso(opened.task.options.standard, opened.machine, opened.surveys[0])
    if opened.task.options.reports:
        result.save(folder)
    else:
        write_text_atomic(dumps(result.as_json()), folder / "evaluation.json")
        write_csv(result.figures, folder / "figures.csv")
    entry = {"verdict": result.verdict or "", "notes": list(result.notes), "estimates": of_evaluation(result).as_json()}
    return result.machine, [entry]


WORK: dict[str, Callable[[Opened, Path], Worked]] = {
    "fit": _fit, "diagnose": _diagnose, "monitor": _monitor, "iso": _iso,
}  # fmt: skip
