"""What is said of the survey behind a compensation: axes that stood still, directions that nothing corrects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from errormodel.controllers.setup import Setup
from identification.compensation.read_motions import notes_on_motions
from identification.compensation.volume import Volume
from identification.results.stored_fit import StoredFit


def first_lines(
    fit: StoredFit, setup: Setup, read: Mapping[str, Sequence[str]] | None, loaded: bool
) -> tuple[str, ...]:
    """What comes before all else in a checklist; `loaded`: whether a control's own file is written."""
    return (*inch_lines(bool(fit.data.get("inches")) and loaded), *still_lines(setup, read), *sign_lines(fit))


def inch_lines(inches: bool) -> list[str]:
    """What comes first of a machine whose file counts in inches: files of all controllers are metric."""
    if not inches:
        return []
    return [
        "FIRST: machine.yaml counts in inches, and all lengths written here are in mm: set the control to mm "
        "(LinuxCNC: [TRAJ] LINEAR_UNITS = mm) before they are loaded, or do not load them"
    ]


def still_lines(setup: Setup, read: Mapping[str, Sequence[str]] | None) -> list[str]:
    """What comes first of rotary axes that the survey did not move, whose place the tables therefore do not know."""
    if read is not None:
        return []
    return [
        f"FIRST: {a.joint} stood at {a.measured[0]:g} deg in the whole survey: what is written is right with it "
        "there only"
        for a in setup.axes
        if a.rotary and a.name not in setup.moving
    ]


def sign_lines(fit: StoredFit) -> list[str]:
    """What comes first of a survey that does not know the sign of its readings."""
    return [
        f"FIRST: the sign of all corrections is that of the readings, which nothing proves: {note}. Measure some of "
        "the same poses again once they act: errors twice as large, in place of none, say that it is the opposite one"
        for note in fit.sign_notes
    ]


def survey_notes(volume: Volume, setup: Setup, held: bool, read: Mapping[str, Sequence[str]] | None) -> tuple[str, ...]:
    """Notes on joints that stood still, directions out of reach, and figures without held-out rows (`held`)."""
    field = volume.field
    still = [a.joint for a in setup.axes if a.name not in setup.moving and read is None]
    reach = np.linalg.matrix_rank(field.jacobian(*volume.poses(1, 0))[0], tol=1e-3)
    return (
        *(notes_on_motions(setup, read) if read is not None else ()),
        *(
            f"the survey did not move {name}: its errors are unknown, and are corrected as they were there"
            for name in still
        ),
        *(
            (f"{', '.join(setup.movers)} reach {reach} of 3 directions: errors along the others stay",)
            if reach < 3
            else ()
        ),
        *(() if held else ("no rows were left out of the fit: the figures are those of the model itself",)),
    )
