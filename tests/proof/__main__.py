"""``python -m tests.proof``: make the cases, seal the truths, run the tool, open the seals, print the table."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import click
from threadpoolctl import threadpool_limits

from tests.proof.cases import make, write
from tests.proof.run_case import run_case
from tests.proof.score import Scored, by, failures, table
from tests.proof.seal import digest, opened, simulator, whole_seal, write_atomic
from tests.proof.specs import Spec, all_specs

QUICK = 40
THROUGH_COMMANDS = 3  # of the first cases


@click.command()
@click.option("--cases", type=int, help="How many (any beginning is a fair sample); all if not given.")
@click.option("--quick", is_flag=True, help=f"The first {QUICK} cases.")
@click.option("--workers", default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("proof-out"), show_default=True)
@click.option("--only", help="One kind (empty, single, weak, mixture, pair, unnamed, unseen, blunder) or one case.")
@click.option("--score-only", is_flag=True, help="Do not run anything: score what is there.")
def main(cases: int | None, quick: bool, workers: int, out: Path, only: str | None, score_only: bool) -> None:
    """Prove the diagnosis on machines with concealed physics. Done cases are kept: a second run goes on."""
    specs = all_specs()
    if only:
        specs = [s for s in specs if only in (s.kind, s.name) or (only in s.effects)]
    specs = specs[: QUICK if quick else cases]
    seals = _sealed(specs, out, workers)
    click.echo(f"{len(specs)} cases sealed: {whole_seal({s.name: seals[s.name] for s in specs})}")
    if not score_only:
        _run(specs, out, workers)
    scored = [_scored(s, out, seals) for s in specs if _done(s, out)]
    click.echo("\n".join(report(scored)))


def report(scored: list[Scored]) -> list[str]:
    """The tables and the failures."""
    lines = [f"{name:<42}{value}" for name, value in table(scored)]
    for key in ("kind", "topology", "plan", "noise"):
        lines += ["", *by(scored, key)]
    return [*lines, "", *failures(scored)]


def _done(spec: Spec, out: Path) -> bool:
    """Whether there is a result for the case's files as they are."""
    path = out / "results" / f"{spec.name}.json"
    return path.exists() and json.loads(path.read_text())["input"] == digest(out / "cases" / spec.name)


def _scored(spec: Spec, out: Path, seals: dict[str, str]) -> Scored:
    truth = opened(out / "sealed" / f"{spec.name}.json", seals[spec.name])
    return Scored(truth, json.loads((out / "results" / f"{spec.name}.json").read_text()))


def _pool(workers: int) -> ProcessPoolExecutor:
    """Processes of one thread each."""
    return ProcessPoolExecutor(workers, initializer=threadpool_limits, initargs=(1,))


def _sealed(specs: list[Spec], out: Path, workers: int) -> dict[str, str]:
    """Make and seal what is not there yet; all of it where the simulator has changed."""
    book = out / "seals.json"
    kept = json.loads(book.read_text()) if book.exists() else {}
    seals: dict[str, str] = kept["seals"] if kept.get("simulator") == simulator() else {}
    missing = [s for s in specs if s.name not in seals]
    with _pool(workers) as pool:
        for spec, seal in zip(missing, pool.map(_make, missing, [out] * len(missing)), strict=True):
            seals[spec.name] = seal
            write_atomic(book, json.dumps({"simulator": simulator(), "seals": seals}, indent=1, sort_keys=True))
    return seals


def _make(spec: Spec, out: Path) -> str:
    return write(make(spec), out / "cases" / spec.name, out / "sealed")


def _run(specs: list[Spec], out: Path, workers: int) -> None:
    results = out / "results"
    left = [(k, s) for k, s in enumerate(specs) if not _done(s, out)]
    with _pool(workers) as pool:
        jobs = [pool.submit(run_case, out / "cases" / s.name, results, k < THROUGH_COMMANDS) for k, s in left]
        with click.progressbar(as_completed(jobs), length=len(jobs), label="diagnosing") as bar:
            for job in bar:
                job.result()


if __name__ == "__main__":
    main()
