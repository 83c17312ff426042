"""``python -m tests.proof``: make the cases, seal the truths, run the tool, open the seals, print the table."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import click
from threadpoolctl import threadpool_limits

from tests.proof.cases import make, write
from tests.proof.leave_out import LEFT_OUT
from tests.proof.run_case import run_case, seconds_file
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
@click.option("--without", type=click.Choice(sorted(LEFT_OUT)), help="Leave a rule out in the cases where it decided.")
@click.option("--score-only", is_flag=True, help="Do not run anything: score what is there.")
def main(
    cases: int | None, quick: bool, workers: int, out: Path, only: str | None, without: str | None, score_only: bool
) -> None:
    """Prove the diagnosis on machines with concealed physics. Done cases are kept: a second run goes on."""
    specs = all_specs()
    if only:
        specs = [s for s in specs if only in (s.kind, s.name) or (only in s.effects)]
    specs = specs[: QUICK if quick else cases]
    seals = _sealed(specs, out, workers)
    click.echo(f"{len(specs)} cases sealed: {whole_seal({s.name: seals[s.name] for s in specs})}")
    if not score_only:
        _run(specs, out, out / "results", workers)
    done = [s for s in specs if _done(s, out, out / "results")]
    scored = [_scored(s, out, out / "results", seals) for s in done]
    if not without:
        click.echo("\n".join(report(scored)))
        return
    where = out / "without" / without
    concerned = [k for k, s in enumerate(scored) if without in s.result.get("rules", [])]
    if not score_only:
        _run([done[k] for k in concerned], out, where, workers, without)
    again = [k for k in concerned if _done(done[k], out, where)]
    pairs = {done[k].name: (scored[k], _scored(done[k], out, where, seals)) for k in again}
    click.echo("\n".join(compared(without, len(done), pairs)))


def compared(rule: str, cases: int, pairs: dict[str, tuple[Scored, Scored]]) -> list[str]:
    """With and without a rule: counts over the cases in which it decided, and the cases that differ."""
    lines = [f"{rule}: decided in {len(pairs)} of {cases} cases; with it, without it"]
    for name, value in (
        ("effects named", lambda s: sum(map(s.named, s.effects))),
        ("effects placed", lambda s: sum(map(s.placed, s.effects))),
        ("names of what is not there", lambda s: len(s.false_names)),
        ("predictions worse than the plain fit's", lambda s: s.worse),
    ):
        before, after = (sum(value(pair[k]) for pair in pairs.values()) for k in (0, 1))
        lines.append(f"  {name:<40}{before:>4}{after:>5}")
    for name, (one, other) in pairs.items():
        what = [sorted(f"{f['effect']}@{f['where']}" for f in s.findings) for s in (one, other)]
        if what[0] != what[1]:
            lines.append(f"  {name:<14}{' '.join(what[0])}  ->  {' '.join(what[1])}")
    return lines


def report(scored: list[Scored]) -> list[str]:
    """The tables and the failures."""
    lines = [f"{name:<42}{value}" for name, value in table(scored)]
    for key in ("kind", "topology", "plan", "noise"):
        lines += ["", *by(scored, key)]
    return [*lines, "", *failures(scored)]


def _done(spec: Spec, out: Path, results: Path) -> bool:
    """Whether there is a result for the case's files as they are."""
    path = results / f"{spec.name}.json"
    there = path.exists() and seconds_file(results, spec.name).exists()
    return there and json.loads(path.read_text())["input"] == digest(out / "cases" / spec.name)


def _scored(spec: Spec, out: Path, results: Path, seals: dict[str, str]) -> Scored:
    truth = opened(out / "sealed" / f"{spec.name}.json", seals[spec.name])
    seconds = float(seconds_file(results, spec.name).read_text())
    return Scored(truth, json.loads((results / f"{spec.name}.json").read_text()), seconds)


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


def _run(specs: list[Spec], out: Path, results: Path, workers: int, without: str = "") -> None:
    left = [(k, s) for k, s in enumerate(specs) if not _done(s, out, results)]
    commands = 0 if without else THROUGH_COMMANDS
    with _pool(workers) as pool:
        jobs = [pool.submit(run_case, out / "cases" / s.name, results, k < commands, without) for k, s in left]
        with click.progressbar(as_completed(jobs), length=len(jobs), label="diagnosing") as bar:
            for job in bar:
                job.result()


if __name__ == "__main__":
    main()
