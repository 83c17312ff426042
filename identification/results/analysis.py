"""What is derived from a fit: computed here and nowhere else, for files, reports, tables and figures alike."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from identification.compensation.field import Field
from identification.estimation.result import Fit
from identification.results.axis_lines import AxisLines
from identification.results.groups import groups_of
from identification.results.location_estimates import LocationEstimate, location_estimates
from identification.results.parameter_table import Estimate, estimates
from identification.results.stored_fit import StoredFit, stored
from identification.uncertainty.budget import Budgets, budgets_of
from identification.uncertainty.further_poses import Gain, gain_of

if TYPE_CHECKING:
    from identification.bayes.posterior import Posterior


class Analysis:
    """A fit with what follows from it; each part is computed when it is first asked for, and once.

    Attributes
    ----------
    fit : the values that all is derived from.
    groups : one entry a base parameter: id, group (formula), members, symbol, meaning, value, std (k = 1), unit.
    gain : what ten more poses would bring.
    parameters : the groups, with their standard uncertainty after ten more poses.
    estimates : the groups in the units that people read.
    location_errors : squareness and parallelism of the axes, as far as the fit determines them.
    stored : what prediction needs.
    budgets : uncertainty budgets (GUM) of the prediction and of each group.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit

    @property
    def posterior(self) -> Posterior | None:
        """The posterior, of a Bayesian fit."""
        return self.fit.posterior

    @cached_property
    def groups(self) -> list[dict[str, Any]]:
        return groups_of(self.fit)

    @cached_property
    def gain(self) -> Gain:
        return gain_of(self.fit)

    @cached_property
    def parameters(self) -> list[dict[str, Any]]:
        gain = self.gain
        out = []
        for k, group in enumerate(self.groups):
            after = {
                "std_after_10_more": float(gain.like_these[k]),
                "std_after_10_best": None if gain.best is None else float(gain.best[k]),
            }
            out.append({n: v for n, v in group.items() if n != "unit"} | after | {"unit": group["unit"]})
        return out

    @cached_property
    def estimates(self) -> list[Estimate]:
        return estimates(self.fit, self.groups)

    @cached_property
    def location_errors(self) -> tuple[LocationEstimate, ...]:
        stored, table = self.stored, self.fit.survey.table
        if not stored.chain.location_errors:
            return ()
        try:
            field = Field.of(stored, table)
        except InputError:  # an effect depends on what was not recorded
            return ()
        return location_estimates(stored, AxisLines.of(field, stored.data["covered"]), table)

    @cached_property
    def stored(self) -> StoredFit:
        return stored(self.fit, self.groups)

    @cached_property
    def budgets(self) -> Budgets:
        return budgets_of(self.fit, self.groups, self.stored)
