"""A cycle of a monitored machine as a notebook uses it."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from identification.monitoring.monitor import Monitored


class MonitorResult:
    """What `identification.monitor` returns.

    Attributes
    ----------
    monitored : the cycle, its judgement and the history with it.
    page : ``monitor.html``, which shows them, if it was written.
    """

    def __init__(self, monitored: Monitored, page: Path | None) -> None:
        self.monitored, self.page = monitored, page

    @property
    def status(self) -> str:
        """``learning``, ``normal`` or ``alarm``."""
        return self.monitored.record.status

    @property
    def accepted(self) -> bool:
        """Whether a cycle in alarm was taken into the normal range."""
        return self.monitored.record.accepted

    @cached_property
    def alarms(self) -> pd.DataFrame:
        """One row an alarm: ``kind``, ``statement``."""
        import pandas as pd

        return pd.DataFrame(self.monitored.alarms, columns=["kind", "statement"])

    @cached_property
    def quantities(self) -> pd.DataFrame:
        """One row a watched quantity: value, std, normal range (``low``, ``high``), in ``unit``."""
        import pandas as pd

        return pd.DataFrame(self.monitored.as_json()["parameters"]).set_index("id")

    @cached_property
    def history(self) -> pd.DataFrame:
        """One row a cycle: ``cycle``, ``survey``, ``status``, ``accepted``, ``flagged``."""
        import pandas as pd

        return pd.DataFrame(self.monitored.as_json()["history"])

    @property
    def plot(self) -> MonitorPlots:
        """Figures of the history."""
        return MonitorPlots(self.monitored)

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.monitoring.text import monitor_lines

        return "\n".join(monitor_lines(self.monitored))

    def __repr__(self) -> str:
        return f"<MonitorResult: cycle {self.monitored.record.number}, {self.status}>"


class MonitorPlots:
    """Figures of a monitored machine."""

    def __init__(self, monitored: Monitored) -> None:
        self._monitored = monitored

    def history(self) -> Figure:
        """Each watched quantity over the cycles with its normal range, those nearest to their limits first."""
        from identification.plots.history import draw_history

        return draw_history(self._monitored.what, self._monitored.records, self._monitored.judged)
