"""Result of measurement planning for the Python API."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

    from identification.planning.plan import Plan


class PlanResult:
    """Result of `identification.plan`.

    Attributes
    ----------
    plan : the design behind it.
    poses : DataFrame of the rows to measure in their order, mm and degrees.
    """

    def __init__(self, plan: Plan, poses: pd.DataFrame) -> None:
        self.plan = plan
        self.poses = poses

    @property
    def rank(self) -> int:
        """Number of parameter groups that the poses identify."""
        return self.plan.groups.rank

    @cached_property
    def uncertainty(self) -> pd.DataFrame:
        """Predicted standard uncertainty (um) in the volume, maximum and median, compared with random poses."""
        import pandas as pd

        rows = {"planned": self.plan.uncertainty, "random": self.plan.random, "twice as many": self.plan.twice}
        table = pd.DataFrame({k: {"worst_um": u.worst_um, "median_um": u.median_um} for k, u in rows.items()}).T
        table.attrs["units"] = dict.fromkeys(table.columns, "um")
        return table

    @cached_property
    def effects(self) -> pd.DataFrame:
        """One row per effect: whether the poses can detect it, from which size, and effects of similar action."""
        import pandas as pd

        rows: list[dict[str, Any]] = self.plan.as_json()["effects"]
        return pd.DataFrame(rows)

    def summary(self) -> str:
        """What the command line prints of it."""
        from identification.planning.text import plan_lines

        return "\n".join(plan_lines(self.plan))

    def as_json(self) -> dict[str, Any]:
        """The plan's figures and verdicts, as ``--json`` writes them."""
        return self.plan.as_json()

    def _repr_html_(self) -> str:
        return (
            f"<p>{len(self.poses)} rows, rank {self.rank}</p>{self.uncertainty.to_html()}{self.poses.head().to_html()}"
        )
