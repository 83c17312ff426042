"""Error motions from point clouds as a notebook uses them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification.registration.register import Registered


class RegistrationResult:
    """What `identification.register` returns.

    Attributes
    ----------
    registered : the mount of the sensor and each displacement behind it.
    table : DataFrame, a survey of the joint's error motions: a row an artefact and warm folder; mm, rad, s.
    notes : what needs attention, as sentences.
    """

    def __init__(self, registered: Registered) -> None:
        self.registered = registered
        self.table = registered.table
        self.notes = registered.notes

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.registration.text import register_lines

        return "\n".join(register_lines(self.registered))
