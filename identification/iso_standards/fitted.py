"""A fitted machine as tests see it: errors of the tool tip at commands, with draws from the fit's covariance.

The errors are those of the machine alone (no frame, instrument or target), actual minus nominal, mm in the axes of the
machine's reference. Draws are of the linear model about the estimates, which is exact to second order in the errors;
what the fit did not identify and acts at the commands is drawn as `predict` counts it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.surveys.record import RecordForm
from identification.compensation.field import Field
from identification.compensation.rows import read_rows
from identification.iso_standards.base import Quantity
from identification.results.axis_lines import AxisLines
from identification.results.location_estimates import LocationEstimate, location_estimates
from identification.results.stored_fit import StoredFit
from identification.uncertainty.measured_range import covered as covered_of
from identification.uncertainty.prediction import unidentified

DRAWS = 400  # of the covariance: the standard uncertainty is then known to 3.5 % (1 / sqrt(2 draws))


@dataclass(frozen=True)
class FittedMachine:
    """A fit, and draws of its parameters.

    Attributes
    ----------
    folder : of the fit.
    changes : (draws, base) changes of the base parameters `ids` from their estimates.
    unknown : (draws, parameters of the chain) of what the fit did not identify, in standard uncertainties.
    covered : lowest and highest command of each joint in the fit's rows, mm and rad.
    lines : of the joints through the middle of what was measured.
    locations : location errors that the fit determines.
    """

    stored: StoredFit
    folder: Path
    field: Field
    ids: tuple[str, ...]
    changes: Array
    unknown: Array
    covered: dict[str, tuple[float, float]]
    record: RecordForm | None
    lines: AxisLines
    locations: tuple[LocationEstimate, ...]

    @classmethod
    def of(cls, stored: StoredFit, folder: Path, record: RecordForm | None) -> FittedMachine:
        """The machine of a fit that lies in `folder`."""
        chain = stored.chain
        table = read_rows(folder, chain.machine)
        table = table[table["role"] == "fit"]
        outer = {*chain.frame_ids, *chain.tool_ids, *chain.instrument_ids}
        kept = [k for k, name in enumerate(stored.base) if name in chain.index and name not in outer]
        covariance = stored.covariance[np.ix_(kept, kept)]
        values, vectors = np.linalg.eigh(covariance) if kept else (np.zeros(0), np.zeros((0, 0)))
        rng = np.random.default_rng(0)  # always the same draws: a figure is not a matter of chance
        normal = rng.standard_normal((DRAWS, len(kept)))
        changes = (normal * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        q = {j.name: table[j.name].to_numpy(dtype=np.float64) for j in chain.machine.joints}
        covered = {name: (float(np.nanmin(v)), float(np.nanmax(v))) for name, v in q.items()}
        field = Field.of(stored, table)
        lines = AxisLines.of(field, stored.data.get("covered") or covered_of(chain, table))
        # of all rows, where the table has a sample of them
        covered |= {j.name: lines.ranges[j.name] for j in chain.machine.joints if j.type == "prismatic"}
        ids = tuple(stored.base[k] for k in kept)
        unknown = rng.standard_normal((DRAWS, len(chain.ids)))
        locations = location_estimates(stored, lines, table)
        return cls(stored, folder, field, ids, changes, unknown, covered, record, lines, locations)

    @property
    def chain(self) -> Chain:
        return self.stored.chain

    @property
    def machine(self) -> Machine:
        return self.chain.machine

    @property
    def joints(self) -> tuple[Joint, ...]:
        return self.machine.joints

    @property
    def source(self) -> str:
        """What it is, in words."""
        fit = self.stored.data
        counts = {
            "measured points": fit.get("fitted", {}).get("n", 0),
            "lengths and angles": sum(entry.get("n", 0) for entry in fit.get("readings") or ()),
            "readings of error motions": sum(entry.get("n", 0) for entry in fit.get("motions") or ()),
        }
        rows = ", ".join(f"{n} {what}" for what, n in counts.items() if n)
        return f"fitted model ({self.folder.name}, from {rows or 'no rows'})"

    @property
    def linear(self) -> list[int]:
        """Columns of the linear joints that moved, one a direction, in the order x, y, z."""
        moved = [
            k
            for k in self.field.movers
            if self.joints[k].type == "prismatic" and np.ptp(self.covered[self.joints[k].name]) > 0
        ]
        return sorted(moved, key=lambda k: int(np.argmax(np.abs(self.toward(self.joints[k])))))

    def reversing(self, joint: Joint) -> bool:
        """Whether the errors depend on the side from which a joint arrives."""
        return joint.name in self.field.reversing

    def middle(self) -> Array:
        """Commands in the middle of what was measured, (joints,) in mm and rad."""
        return np.array([sum(self.covered[j.name]) / 2 for j in self.joints])

    def range(self, joint: Joint) -> tuple[float, float]:
        """Travel of a joint that was measured, mm or rad.

        Raises
        ------
        InputError
            It did not move.
        """
        low, high = self.covered[joint.name]
        if high - low <= 1e-9 * max(1.0, abs(high)):
            raise InputError(str(self.folder), f"{joint.name} did not move in the survey of this fit", "Measure it")
        return low, high

    def nominal(self, q: Array) -> Array:
        """Nominal points (n, 3) of commands (n, joints), mm."""
        return self.field.nominal(q)

    def errors(self, q: Array, direction: Array | None = None) -> Array:
        """Errors at commands, (1 + draws, n, 3) in mm: the estimate first.

        Parameters
        ----------
        q : (n, joints) mm and rad.
        direction : (n, joints) of +-1, the sides of approach; None: from below.
        """
        came = np.ones_like(q) if direction is None else direction
        best = self.field.actual(q, came) - self.field.nominal(q)
        chain = self.chain
        names = [i for i in chain.machine_ids if i not in chain.instrument_ids]
        design = chain.kernel("design", tuple(names), outputs=(0, 1, 2))(self.field.rows(q, came))
        design = design.reshape(len(names), 3, len(q))
        own = [names.index(i) for i in self.ids]
        changes = np.tensordot(self.changes, design[own], axes=1)
        for name, column in unidentified(self.stored, names, design):
            changes += self.unknown[:, chain.index[name], None, None] * column
        return np.concatenate([best[None], best + changes.transpose(0, 2, 1)])

    def location_errors(self) -> list[Quantity]:
        """Squareness and parallelism between lines, as far as the fit determines them."""
        basis = "covariance of the fit"
        return [Quantity(e.symbol, "", e.spoken, e.value, "rad", 2 * e.std, basis) for e in self.locations]

    def path(self, joint: Joint, count: int, at: Array | None = None) -> Array:
        """Commands (count, joints) of a joint along its measured travel, the others in the middle (or `at`)."""
        q = np.tile(self.middle() if at is None else at, (count, 1))
        q[:, self.joints.index(joint)] = np.linspace(*self.range(joint), count)
        return q

    def toward(self, joint: Joint, at: Array | None = None) -> Array:
        """Unit vector (3,) in which the tip moves with a linear joint, in the axes of the reference."""
        q = np.tile(self.middle() if at is None else at, (2, 1))
        q[1, self.joints.index(joint)] += 1.0
        step = np.diff(self.nominal(q), axis=0)[0]
        return np.asarray(step / np.linalg.norm(step))
