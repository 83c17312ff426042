"""Error messages for point cloud files that cannot be read."""

from __future__ import annotations

from errormodel.exceptions import InputError

CURE = "Write the cloud again, or as csv with x, y, z"


def unreadable(name: str, kind: str, reason: str | Exception) -> InputError:
    """Error for a file that violates its own format; `reason` is the message of its reader."""
    text = " ".join(str(reason).split())[:100] or type(reason).__name__
    return InputError(name, f"not readable as {kind}: {text}", CURE)


def too_short(name: str, promised: int, there: int | None = None) -> InputError:
    """Error for a file whose header announces more points than it holds."""
    held = "the file is too short for them" if there is None else f"the file holds {there}"
    return InputError(name, f"its header promises {promised} points, {held}", CURE)
