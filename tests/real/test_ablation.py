"""Something real and known is taken out of a model and asked for again: does it come back, and where it was?

Of the arm, each so-many-th pose of series C, with the curves declared that the whole series show. The printer's bed is
in `test_real_printer`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from identification.diagnosis.pipeline import diagnose
from tests.helpers.arm import arm, recorded

pytestmark = pytest.mark.long


def test_a_joints_curve_comes_back(ur10: Path) -> None:
    """The first finding is the missing one. Others may follow that are smaller: what the full model lacks as well."""
    machine = arm(ur10, without="J2")
    result = diagnose(machine, recorded(ur10, machine, 20))
    first, *others = result.diagnosis.findings
    assert (first.effect, first.where, first.motion, first.driver) == ("higher-order-geometry", "J2", ["eb"], ["J2"])
    assert first.probability > 0.94  # 0.952 is the most that a name gets: it may be what no catalogue has
    for other in others:
        assert other.heldout_rms_um.before < 0.7 * first.heldout_rms_um.before
    assert result.final.heldout.rms_um < 0.6 * result.baseline.heldout.rms_um


def test_a_constant_of_a_member_comes_back(ur10: Path) -> None:
    """The twist of the forearm, -1.4 mrad in the full model, as the constant rotation at the joint that it carries."""
    full, machine = arm(ur10), arm(ur10, without="T3.ea")
    result = diagnose(machine, recorded(ur10, machine, 20))
    (found,) = (f for f in result.diagnosis.findings if f.where == "J4")
    others = [f.driver for f in result.diagnosis.findings if f is not found]
    # beside it, only what the full model does not explain either
    assert sorted(others) == sorted(f.driver for f in diagnose(full, recorded(ur10, full, 20)).diagnosis.findings)
    assert (found.effect, found.where, found.motion, found.driver) == ("higher-order-geometry", "J4", ["ea"], [])
    (amount,) = found.parameters
    assert abs(amount.value + 1.42e-3) < 3 * amount.std < 6e-4
    assert "the same in all rows: ea of J4 (EAJ4) is off by" in found.statement
    assert result.final.heldout.rms_um < result.baseline.heldout.rms_um
