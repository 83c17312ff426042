"""An estimate with its standard uncertainty (GUM), and whether it is significant."""

from __future__ import annotations

from dataclasses import dataclass

SIGNIFICANT = 3.0  # standard uncertainties: 99.7 % of a normal distribution is nearer to zero


@dataclass(frozen=True)
class Estimate:
    """A value and its standard uncertainty, in the same unit."""

    value: float
    std: float

    @property
    def significant(self) -> bool:
        """Whether the value differs from zero by more than `SIGNIFICANT` standard uncertainties."""
        return abs(self.value) > SIGNIFICANT * self.std
