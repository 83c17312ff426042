"""Channels of a survey's rows and of its observations, made when first asked for."""

from __future__ import annotations

from collections.abc import Mapping

from errormodel.arrays import Array, Index, Mask
from errormodel.channels import POINT_CHANNELS, columns, root
from errormodel.survey import Survey
from errormodel.temperature_courses import clock_name, clocks


class LazyChannels(dict[str, Array]):
    """Channels at the observations: made when first asked for."""

    def __init__(self, source: Mapping[str, Array], keep: Mask | Index) -> None:
        super().__init__()
        self._source, self._keep = source, keep

    def __missing__(self, name: str) -> Array:
        self[name] = self._source[name][self._keep]
        return self[name]


class RowChannels(dict[str, Array]):
    """Channels over a survey's rows: made when first asked for. Derived ones, of which there are many, are not kept."""

    def __init__(self, survey: Survey, points: Array) -> None:
        super().__init__(zip(POINT_CHANNELS, points, strict=True))
        # labels as numbers: channels that follow files and runs ask for them again and again
        labels = {name: survey.table[name].astype("category") for name in ("file", "run") if name in survey.table}
        self._table, self._clocks = survey.table.assign(**labels), set[str]()

    def __missing__(self, name: str) -> Array:
        side = f"dir_{root(name)}"
        if name.startswith("play(") and side not in self:  # what every width of it asks for
            self._table = self._table.assign(**{side: self[side]})
        sensor = root(name)
        if name.startswith(("lag(", "initial(")) and {sensor, "time"} <= {*self._table} and sensor not in self._clocks:
            self._clocks.add(sensor)  # what every lag of it asks for
            self._table = self._table.assign(**{clock_name(sensor): clocks(self._table, sensor)})
        (values,) = columns(self._table, [name])
        if name == root(name):
            self[name] = values
        return values


def runs_of(survey: Survey) -> list[tuple[str, int]]:
    """Labels of the runs in order, with the number of their rows."""
    counts = survey.table["run"].value_counts()
    return sorted(zip(map(str, counts.index), counts.tolist(), strict=True))
