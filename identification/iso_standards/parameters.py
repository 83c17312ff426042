"""Parameters of a fitted model: the value and expanded uncertainty of every group and location error."""

from __future__ import annotations

from identification.iso_standards.base import Evaluation, Quantity, Standard
from identification.iso_standards.fitted import FittedMachine


class Parameters(Standard):
    """The parameters themselves, for tolerances of parameters."""

    number = "parameters"
    title = "Parameters of the fitted model (ISO 230-1:2012, symbols)"

    def of_fit(self, model: FittedMachine) -> Evaluation:
        quantities = model.location_errors()
        for p in model.stored.data["parameters"]:
            if str(p["id"]).startswith(("frame", "zero[")):
                continue
            words = str(p["group"]) + (f", {p['symbol']}" if p["symbol"] else "")
            std = 2 * float(p["std"])
            quantities.append(
                Quantity(str(p["id"]), "", words, float(p["value"]), str(p["unit"]), std, "covariance of the fit")
            )
        return Evaluation(self.number, self.title, model.source, tuple(quantities))
