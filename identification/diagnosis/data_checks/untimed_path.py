"""Rows that seem to be read on the fly without times: a delay of the readings would look like what it is not."""

from __future__ import annotations

from collections.abc import Iterator

from identification.diagnosis.linear.linear_model import LinearModel

UNTIMED = (
    "the rows' path runs on, and no column time says whether they were read on the fly: if so, a delay of the readings "
    "looks like hysteresis or a memory of the path. Record the time of each row"
)


def untimed_path(linear: LinearModel) -> Iterator[str]:
    """A note where rows seem to be read on the fly, and no times of theirs were recorded."""
    scene = linear.scene
    if scene.runs_on and not (scene.varies("time") or scene.varies("feed")):
        yield UNTIMED
