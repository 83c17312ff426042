"""Volumetric error that each controller's tables take away, on unseen poses of machines whose errors are known.

``python -m tests.benchmarks.compensation [MACHINE ...] [--controller NAME ...] [--poses N] [--real]``

Every machine is simulated exactly with random errors and a laser tracker's noise, surveyed, fitted, and compensated
from the fit; what is left is judged with the true machine. *ideal*: commands by the exact inverse of the fitted model.
*claimed*: what the tool prints, by its own model. *real*: what the true machine leaves at some of the poses where the
real controller put its motors, with ``--real`` and where it is installed (LinuxCNC); *after* is emulated. *exact*: the
same tables made from the true machine: what is lost beyond them is the survey's noise. *best*: what the
format's structure can do within its limits with the fitted model, found by optimisation with twice the points, once
for the least root mean square and once with a tenth of that given up for the worst error: no tables have both.
The share *of ideal* counts for formats that can express everything (ISG, lattice), the share *of best* for all; both
are of the root mean square error that is removed. *CPU s*: of the tables alone (`compensate_time` has
the whole command). *worst*: the worst error over that of the best for the worst.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np

from errormodel.chain import Chain
from errormodel.controllers import registry, target
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.exceptions import InputError
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine_file import library, read_machine
from identification.compensation import reduction
from identification.compensation.assessment import Correct, Error, emulated, nothing, remaining
from identification.compensation.compensate import best_tables
from identification.compensation.field import Field
from identification.compensation.rows import Rows
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from tests.helpers import linuxcnc
from tests.helpers.chains import errors
from tests.helpers.surveys import measured, positions, stored, survey

TRACKER = LaserTracker(type="laser-tracker", station=[0.0, 0.0, 0.0], range=[0.5e-3, 0.0], angle=1.2e-6)
UNSEEN = 512
STOPS, FAST = 60, 20_000.0  # poses in the real controller, and mm/s there
MANY = 600  # values: twice the points, and the best for the worst, only where there are fewer


@dataclass(frozen=True)
class Case:
    """A machine whose truth is known, as its fit sees it, and the poses that nobody saw."""

    volume: Volume  # by the fit
    truth: Volume
    setup: Setup
    rows: Rows

    @classmethod
    def of(cls, name: str, poses: int, seed: int = 1, resolution: float | None = None) -> Case:
        machine = read_machine(name)
        chain = Chain(machine)
        p = errors(chain, seed)
        table = positions(measured(machine, p, poses, seed + 10, noise=TRACKER))
        fit = stored(fit_machine(machine, survey(table, instrument=TRACKER)))
        field = Field.of(fit, table)
        volume = Volume.of(field, table, free=True)
        truth = Volume(Field(field.chain, p, field.movers, field.state), volume.low, volume.high, True)
        q, came = volume.poses(UNSEEN, 99)
        tool = np.tile(np.asarray(machine.tool, dtype=np.float64), (len(q), 1))
        rows = Rows(q, came, tool, np.zeros((len(q), 3)), np.full(len(q), "", dtype=object), "unseen")
        return cls(volume, truth, volume.setup(None, resolution)[0], rows)

    def left(self, correct: Correct) -> Error:
        """The true error after commands that were made from the fit."""
        return Error.of(remaining(self.truth, correct, self.rows), self.rows.q)

    def corrected(self, controller: Controller, volume: Volume) -> Correct:
        """Commands by a controller's tables as they come back from its files, made from `volume`."""
        files = controller.write(best_tables(controller, self.setup, volume), self.setup)
        return emulated(controller, controller.read(files, self.setup), self.setup, self.volume)

    def best(self, controller: Controller, given_up: float) -> Correct:
        """Commands by the best that the structure allows, for the worst pose as far as the mean may be given up."""
        fine = replace(self.setup, axes=tuple(replace(a, intervals=min(2 * a.intervals, 48)) for a in self.setup.axes))
        terms = controller.structures(fine)[-1]
        if sum(t.size for t in terms) > MANY:
            fine, given_up = self.setup, 1e-6
            terms = controller.structures(fine)[-1]
        sample = self.volume.sample(fine, 24_000 if len(terms) < 10 else 4000, seed=5)
        with mock.patch.multiple(reduction, GIVEN_UP_SHARE=given_up, MOST_RMS_INCREASE=given_up, STILL_SHARE=0.0):
            tables = reduction.reduce(controller, fine, terms, sample, controller.most_tables)
        return emulated(controller, controller.read(controller.write(tables, fine), fine), fine, self.volume)


@dataclass(frozen=True)
class Line:
    """One line of the table; errors as rms and worst, um."""

    controller: str
    after: Error
    exact: Error
    best: Error
    least_worst: Error
    claimed: Error
    of_ideal: float
    of_best: float
    seconds: float  # of CPU that the tables took
    real: tuple[Error, Error] | None = None  # in the real controller, and emulated at the same poses


def judged(case: Case, name: str, real: bool = False) -> Line:
    """One controller on one machine; `real`: in the real controller, too, where there is one."""
    kind = target(name)
    before, ideal = case.left(nothing), case.left(case.volume.ideal)
    if not isinstance(kind, Controller):  # exact but for rounding
        return Line(name, ideal, ideal, ideal, ideal, claimed(case, case.volume.ideal), 1.0, 1.0, 0.0)
    kind.suits(case.setup)
    start = time.process_time()
    correct = case.corrected(kind, case.volume)
    seconds = time.process_time() - start
    after, exact = case.left(correct), case.left(case.corrected(kind, case.truth))
    # of a lattice over all axes, which follows everything, the ideal is the best
    lattice = all(t.inputs == case.setup.moving for t in kind.structures(case.setup)[-1])
    best, worst = (ideal, ideal) if lattice else (case.left(case.best(kind, g)) for g in (1e-6, 0.1))

    def share(of: Error) -> float:
        gain = before.rms_um - of.rms_um
        return (before.rms_um - after.rms_um) / gain if gain > 0.01 * before.rms_um else 1.0

    told = claimed(case, correct)
    stops = in_linuxcnc(case, kind) if real and name.startswith("linuxcnc") else None
    return Line(name, after, exact, best, worst, told, share(ideal), share(best), seconds, stops)


def claimed(case: Case, correct: Correct) -> Error:
    """What the fit believes to be left, at the same poses."""
    return Error.of(remaining(case.volume, correct, case.rows), case.rows.q)


def in_linuxcnc(case: Case, kind: Controller) -> tuple[Error, Error] | None:
    """What the true machine leaves where the real controller puts its motors, and by emulation; None: not installed."""
    if shutil.which("linuxcnc") is None or shutil.which("halcompile") is None:
        return None
    files = kind.write(best_tables(kind, case.setup, case.volume), case.setup)
    if "matrix.hal" in files:  # kinematics that a package may lack: a test runs them
        return None
    rows, to_rad = case.rows.part(np.arange(len(case.rows.q)) < STOPS, ""), case.truth.field.rotary
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text)
        component = linuxcnc.built(folder) if f"{linuxcnc.COMPONENT}.c" in files else None
        controller = linuxcnc.Controller.of(case.setup, files, component, speed=FAST)
        order = [case.setup.names.index(letter) for letter in controller.letters]
        places = case.truth.field.outward(rows.q)[:, order].round(4)
        q, motor, _ = controller.stands(folder, places)
    here, there = (np.where(to_rad, np.radians(v), v) for v in (q, motor))
    same = replace(rows, q=here)
    emulation = emulated(kind, kind.read(files, case.setup), case.setup, case.volume)
    done: list[Correct] = [lambda *_: there, emulation]
    found = [Error.of(remaining(case.truth, c, same), q) for c in done]
    return found[0], found[1]


def table(name: str, controllers: list[str], poses: int, resolution: float | None, real: bool = False) -> Iterator[str]:
    case = Case.of(name, poses, resolution=resolution)
    before, ideal = case.left(nothing), case.left(case.volume.ideal)
    yield f"\n{name}: before {_pair(before)}, after the ideal compensation {_pair(ideal)} um (rms / worst)"
    yield (
        f"  {'controller':16}{'after':>16}{'exact':>16}{'best':>16}{'best for worst':>16}"
        f"{'claimed':>16}{'of ideal':>10}{'of best':>9}{'worst':>7}{'CPU s':>7}"
    )
    for controller in controllers:
        try:
            line = judged(case, controller, real)
        except InputError as error:
            yield f"  {controller:16}  {error.found}"
            continue
        shares = f"{100 * line.of_ideal:9.1f}%{100 * line.of_best:8.1f}%"
        worst = line.after.worst_um / min(e.worst_um for e in (line.best, line.least_worst))
        errors = "".join(f"{_pair(e):>16}" for e in (line.after, line.exact, line.best, line.least_worst, line.claimed))
        stops = (
            f"  real {_pair(line.real[0])} at {STOPS} stops, emulated there {_pair(line.real[1])}" if line.real else ""
        )
        yield f"  {controller:16}{errors}{shares}{worst:7.2f}{line.seconds:7.1f}{stops}"


def _pair(error: Error) -> str:
    return f"{error.rms_um:.2f} / {error.worst_um:.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", default=list(library()))
    parser.add_argument("--controller", action="append")
    parser.add_argument("--poses", type=int, default=300)
    parser.add_argument("--resolution", type=float)
    parser.add_argument("--real", action="store_true", help="in the real LinuxCNC, too")
    given = parser.parse_args()
    for name in given.machines:
        for line in table(name, given.controller or list(registry()), given.poses, given.resolution, given.real):
            print(line, flush=True)


if __name__ == "__main__":
    main()
