"""Logs of temperatures: a time and nothing but temperatures, on a clock of their own."""

from __future__ import annotations

import re

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.layout import Layout
from errormodel.raw_formats.sensor_names import sensor_of
from errormodel.raw_formats.table_columns import columns_of, renamed

_TIME = re.compile(r"(time|date|clock|stamp|zeit|datum|uhrzeit|elapsed|seconds|no|nr|#|index|sample)", re.IGNORECASE)


class TemperatureLog(RawFormat):
    """Every column but the time is a temperature, by its unit or its name."""

    name = "temperature-log"
    title = "a log of temperatures"
    source = "tables as loggers of several makers export them: no common description"

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named:
            return False
        sensors = [n for n, u in zip(table.names, table.units, strict=True) if sensor_of(n, u)]
        rest = [n for n in table.names if n not in sensors]
        return bool(sensors) and bool(rest) and all(_TIME.search(n) for n in rest) and _any_time(table, rest)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        recording = columns_of(raw, asked)
        names = {str(n): sensor_of(str(n), recording.units.get(str(n), "")) for n in recording.frame}
        names = {old: new for old, new in names.items() if new}
        if "time" not in recording.frame:
            own = [str(n) for n in recording.frame if re.search(r"time|elapsed|seconds|zeit", str(n), re.IGNORECASE)]
            names |= {own[0]: "time"} if own else {}
        return renamed(recording, names)


def _any_time(table: Layout, rest: list[str]) -> bool:
    return any(re.search(r"time|date|elapsed|seconds|stamp|zeit|datum", n, re.IGNORECASE) for n in rest)
