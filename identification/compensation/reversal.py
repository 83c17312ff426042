"""Fitted backlash and lost motion as backlash parameters of a controller, and as lines of the checklist.

Reversal values in mm or deg of the axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Reversal, Setup
from errormodel.controllers.tables import Tables
from errormodel.effects import make
from identification.compensation.assessment import Correct
from identification.compensation.field import Field

LEAST_BACKLASH = 5e-4  # mm or deg: smaller values are not written, below the resolution of usual parameters


def reversals(field: Field, letters: Mapping[str, str]) -> dict[str, Reversal]:
    """Reversal values of axes whose effects have one, such as backlash (mm, deg), by axis.

    Parameters
    ----------
    letters : axis of each joint.
    """
    chain = field.chain
    out: dict[str, Reversal] = {}
    for spec, ids in zip(chain.machine.effects, chain.effect_ids, strict=True):
        values = [float(field.values[chain.index[i]]) for i in ids]
        effect = make(spec)
        ends = effect.reversal(values)
        if ends is None:
            continue
        joint = next(j for j in field.joints if j.name == effect.where)
        unit = 180 / np.pi if joint.type == "rotary" else 1.0
        before = out.get(letters[joint.name], Reversal(0.0, 0.0))
        out[letters[joint.name]] = Reversal(before.low + unit * ends[0], before.high + unit * ends[1])
    return {name: r for name, r in out.items() if max(abs(r.low), abs(r.high)) >= LEAST_BACKLASH}


def held_by_tables(tables: Tables) -> frozenset[str]:
    """Axes whose tables differ with the direction of travel and so contain the backlash."""
    return frozenset(t.term.inputs[0] for t in tables if t.term.direction)


def left_to_parameters(controller: Controller, setup: Setup, tables: Tables) -> dict[str, Reversal]:
    """Backlash that the tables do not contain and a parameter of the control can take."""
    if not controller.backlash_parameter:
        return {}
    return {name: r for name, r in setup.reversals.items() if name not in held_by_tables(tables)}


def to_add(controller: Controller, setup: Setup, tables: Tables) -> dict[str, Reversal]:
    """The same without axes that are ahead of their command, of which no parameter is to be raised."""
    return {name: r for name, r in left_to_parameters(controller, setup, tables).items() if r.mean < 0}


def settings_of(controller: Controller, setup: Setup, found: Mapping[str, Reversal]) -> list[tuple[str, str]]:
    """Parameters of the control for reversal values, each with its value as the control takes it."""
    return [
        (_parameter(controller, setup, name), controller.backlash_value(setup, name, -r.mean))
        for name, r in sorted(found.items())
    ]


def _parameter(controller: Controller, setup: Setup, name: str) -> str:
    return controller.backlash_parameter.format(
        axis=controller.address(setup, name), number=controller.number(setup, name)
    )


def with_backlash(correct: Correct, setup: Setup, found: Mapping[str, Reversal], field: Field) -> Correct:
    """Corrected commands with the backlash parameters set to the mean over the travel."""
    size = np.array([found[n].mean if n in found else 0.0 for n in setup.names])
    unit = np.where(field.rotary, np.pi / 180, 1.0)

    def out(q: Array, direction: Array, tool: Array | None) -> Array:
        return np.asarray(correct(q, direction, tool) - direction[:, : len(size)] * size * unit / 2)

    return out


def reversal_lines(controller: Controller, setup: Setup, tables: Tables) -> list[str]:
    """Checklist lines about backlash, axis by axis."""
    lines = []
    held = held_by_tables(tables)
    for name, r in sorted(setup.reversals.items()):
        axis = setup.axis(name)
        unit, factor = ("arcsec", 3600.0) if axis.rotary else ("um", 1000.0)
        size = f"{-factor * r.mean:+.1f} {unit}"
        if abs(r.high - r.low) > 0.05 * abs(r.mean):
            size += f" ({-factor * r.low:+.1f} at {axis.travel[0]:g}, {-factor * r.high:+.1f} at {axis.travel[1]:g})"
        found = f"backlash of {name}: {size}, positive where the axis stays behind its direction of travel"
        ahead = r.mean > 0
        if ahead:
            found += (
                ". It is ahead of its command, which no worn drive makes: a backlash parameter that is set too large "
                f"does, readings in motion that are late, or a wrong column dir_{axis.joint} of the survey"
            )
        parameter = _parameter(controller, setup, name)
        if name in held:
            lines.append(f"{found}. These tables hold it, one for each direction" + _beside(controller, parameter))
        elif parameter and ahead:
            value = controller.backlash_value(setup, name, r.mean).lstrip("+")
            lines.append(
                f"{found}. These tables do not hold it: {parameter}: if {value} or more was set during the survey, "
                "take that off; else leave it"
            )
        elif parameter:
            value = controller.backlash_value(setup, name, -r.mean)
            lines.append(
                f"{found}. These tables do not hold it: {parameter}: add {value} to what was set during the survey, "
                f"and set the zero of {name} again: its positions move by half of that, to which side depends on how "
                "it references"
            )
        else:
            lines.append(f"{found}. It stays: neither these tables nor a parameter of {controller.title} hold it")
    return lines


def _beside(controller: Controller, parameter: str) -> str:
    return f": {controller.backlash_beside.format(parameter)}" if parameter else ""
