"""Klipper: skew_correction, a bed_mesh profile, and z_thermal_adjust.

Skew: ``x' = x - y f_xy - z (f_xz - f_xy f_yz)``, ``y' = y - z f_yz``. Mesh: heights added to Z, rows from the smallest
Y, columns from the smallest X; with mesh_x_pps and mesh_y_pps 0 it is bilinear, and edge values hold. Klipper corrects
X and Y by skew only, and no pitch errors; axis_twist_compensation corrects the probe's readings, not the nozzle's
position, and is written where the probe's offset is known.

Source: Klipper docs/Config_Reference.md, klippy/extras/bed_mesh.py, skew_correction.py, z_thermal_adjust.py.
"""

from __future__ import annotations

import configparser
from dataclasses import replace
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import header
from errormodel.controllers.klipper_probe import probing
from errormodel.controllers.printers import Printer, heights_of, skew_tables, skewed, skews_of
from errormodel.controllers.probing import Gap, Probing
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_points, even_step
from errormodel.controllers.text import Comment, Files, one_file
from errormodel.controllers.thermal import States, Thermal, growths
from errormodel.exceptions import InputError

MESH_PROFILE = "errormodel"  # name of the mesh profile
HASH_COMMENT = Comment("# ")


class Klipper(Printer):
    """One file to include in printer.cfg."""

    name: ClassVar[str] = "klipper"
    title: ClassVar[str] = "Klipper (skew_correction, bed_mesh)"
    source: ClassVar[str] = "Klipper Config_Reference.md; bed_mesh.py, skew_correction.py"
    scale_setting: ClassVar[str] = "rotation_distance of [stepper_{lower}]: multiply by {distance:.6f}"
    needs: ClassVar[str] = "[skew_correction] and [bed_mesh] in printer.cfg; axes X and Y, and Z for the heights"
    back: ClassVar[str] = "SET_SKEW CLEAR=1 and BED_MESH_CLEAR; take the include and the start lines out, RESTART"
    shown: ClassVar[tuple[str, ...]] = (
        "Home all axes. Load skew and mesh as the checklist says. SET_GCODE_OFFSET X=0 Y=0 Z=0.",
        "At each place: G90, G1 X.. Y.. Z.. F1200 (first Z, then X and Y), M400, GET_POSITION.",
        "Its line 'toolhead' minus its line 'gcode' must be:",
    )
    comment: ClassVar[Comment | None] = HASH_COMMENT
    most_points: ClassVar[int] = 100

    def emulate(
        self, tables: Tables, setup: Setup, q: Array, direction: Array | None = None, longer: Array | None = None
    ) -> Array:
        skew, mesh = skews_of(tables), heights_of(tables)
        xy, xz, yz = (-skew[k] for k in ("XY", "XZ", "YZ"))
        y, z = (q[:, setup.place(n)] if n in setup.names else np.zeros(len(q)) for n in "YZ")
        moved = {"X": -y * xy - z * (xz - xy * yz), "Y": -z * yz}
        out = np.column_stack([moved.get(m, np.zeros(len(q))) for m in setup.movers])
        if mesh is not None:  # the mesh is evaluated after the skew, at the position actually commanded
            out[:, setup.movers.index("Z")] += mesh.at(setup, skewed(q, out, setup), np.ones_like(q))
        return out

    def quantum(self, setup: Setup) -> float:
        return 1e-6 * (2 + sum(abs(v) for a in setup.axes for v in a.travel) / 1000)

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        skew, mesh = skews_of(tables), heights_of(tables)
        lines = [*header(self, setup), f"[skew_correction {MESH_PROFILE}]"]
        lines += [f"{k.lower()}_skew: {-v:.9f}" for k, v in skew.items()]
        if mesh is not None:
            term = mesh.term
            for k in range(2):
                check_points(term, self.most_points, k)
                even_step(term, k)
                if len(term.grids[k]) < self.least_points:
                    raise InputError(f"mesh along {term.inputs[k]}", f"{len(term.grids[k])} points", "Give 3 or more")
            (x0, *_, x1), (y0, *_, y1) = term.grids
            lines += [f"[bed_mesh {MESH_PROFILE}]", "version: 1", "points:"]
            lines += ["    " + ", ".join(f"{v:.6f}" for v in row) for row in mesh.values.T]
            lines += [f"x_count: {term.shape[0]}", f"y_count: {term.shape[1]}", "mesh_x_pps: 0", "mesh_y_pps: 0"]
            lines += ["algo: lagrange", "tension: 0.2"]
            lines += [f"min_x: {x0:.9g}", f"max_x: {x1:.9g}", f"min_y: {y0:.9g}", f"max_y: {y1:.9g}"]
        return {"errormodel.cfg": "\n".join(lines) + "\n"}

    def thermal(self, states: States, setup: Setup) -> Thermal | None:
        """``z_thermal_adjust``: the height as a linear function of one temperature."""
        found = next((g for g in growths(states, setup, self.emulate) if g.axis == "Z"), None)
        if found is None:
            return None
        middle = found.offset + found.slope * sum(setup.axis("Z").measured) / 2
        law = replace(found, offset=round(min(max(middle, -1.0), 1.0), 6), slope=0.0)
        lines = [
            HASH_COMMENT.line(f"Z follows {law.sensor} in place of a mesh for each temperature:"),
            HASH_COMMENT.line(f"use it with the middling folder only, home Z at {law.zero:.1f} degC"),
            HASH_COMMENT.line("(the firmware adds -temp_coeff times the warming since Z was homed)"),
            "[z_thermal_adjust]",
            f"temp_coeff: {-law.offset:.6f}",
            "# sensor_type, sensor_pin: those of the sensor on the machine's frame",
        ]
        return Thermal({"z_thermal_adjust.cfg": "\n".join(lines) + "\n"}, [law])

    def probing(self, setup: Setup, gap: Gap) -> Probing:
        return probing(setup, gap)

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".cfg")
        parser = configparser.ConfigParser(delimiters=(":",), inline_comment_prefixes=("#",))
        try:
            parser.read_string(text)
            skew = parser[f"skew_correction {MESH_PROFILE}"]
            out = skew_tables({k: -float(skew[f"{k.lower()}_skew"]) for k in ("XY", "XZ", "YZ")}, setup)
            if f"bed_mesh {MESH_PROFILE}" in parser:
                out.append(_mesh(dict(parser[f"bed_mesh {MESH_PROFILE}"])))
        except (configparser.Error, KeyError, ValueError) as error:
            raise InputError(name, f"not a configuration that was written here ({error})", "Write it again") from error
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "printer.cfg: [include errormodel.cfg], [skew_correction], [bed_mesh] (fade_end: 0, split_delta_z: 0.01)",
            f"start G-code: SKEW_PROFILE LOAD={MESH_PROFILE}, BED_MESH_PROFILE LOAD={MESH_PROFILE}",
            "off: SET_SKEW CLEAR=1, BED_MESH_CLEAR",
            "a mesh that was probed replaces this one and does not know the nozzle's own errors: do not load both",
            "[include axis_twist.cfg], and calibrate the probe's z_offset again"
            if setup.probe
            else "axis_twist_compensation (what a probe reads) is left as it is: --probe X Y writes it, too",
        ]


def _mesh(keys: dict[str, str]) -> Table:
    values = np.array([[float(v) for v in row.split(",")] for row in keys["points"].strip().splitlines()])
    shape = (int(keys["x_count"]), int(keys["y_count"]))
    if values.T.shape != shape:
        raise ValueError(f"{values.T.shape} points where {shape} belong")
    grids = tuple(
        tuple(np.round(np.linspace(float(keys[f"min_{a}"]), float(keys[f"max_{a}"]), n), 9).tolist())
        for a, n in zip("xy", shape, strict=True)
    )
    return Table(Term("Z", ("X", "Y"), grids), values.T)
