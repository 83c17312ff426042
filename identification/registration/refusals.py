"""How a file of a point cloud that cannot be read is refused."""

from __future__ import annotations

from errormodel.exceptions import InputError

CURE = "Write the cloud again, or as csv with x, y, z"


def unreadable(name: str, kind: str, reason: str | Exception) -> InputError:
    """The refusal of a file that breaks its own format; `reason` in the words of whoever read it."""
    text = " ".join(str(reason).split())[:100] or type(reason).__name__
    return InputError(name, f"not readable as {kind}: {text}", CURE)


def too_short(name: str, promised: int, there: int | None = None) -> InputError:
    """The refusal of a file whose header promises more points than it holds."""
    held = "the file is too short for them" if there is None else f"the file holds {there}"
    return InputError(name, f"its header promises {promised} points, {held}", CURE)
