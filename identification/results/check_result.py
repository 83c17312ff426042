"""A survey that was looked at before a fit, as a notebook and the command line use it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification.importing.check import Checked


class CheckResult:
    """What `identification.check` returns.

    Attributes
    ----------
    checked : the survey, how its points lie beside the commanded ones, and which groups its poses determine.
    notes : what needs attention, as sentences.
    """

    def __init__(self, checked: Checked) -> None:
        self.checked = checked
        self.notes = checked.survey.notes

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.importing.check import check_lines

        return "\n".join(check_lines(self.checked))
