"""A name beside which as much is left by the same drivers is none."""

from __future__ import annotations

import pytest

from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.results.findings import Finding, HeldOut
from identification.diagnosis.results.remainder import checked_remainder
from identification.diagnosis.results.residual_dependence import Dependence
from tests.helpers.findings import made

GROWTH = made("structure-drift", element="X", motion="dz", sensor="T_bed")
SAID = Finding("structure-drift", "X", "X grows.", 0.98, 1e-9, HeldOut(10.0, 8.0), "measure again", driver=["T_bed"])


@pytest.mark.parametrize(
    ("channels", "size_um", "kept"),
    [
        (("time",), 4.0, False),  # 16 of 36 um2: as much is no departure from a form
        (("time",), 2.0, True),
        (("X", "Y"), 4.0, True),  # of another cause
        (("before(X)",), 4.0, True),
        (("X", "T_air"), 4.0, False),  # all temperatures and the clock are one cause
    ],
)
def test_a_name_falls_with_what_is_left_beside_it(channels: tuple[str, ...], size_um: float, kept: bool) -> None:
    log = DecisionLog()
    found = checked_remainder(SAID, GROWTH, Dependence(channels, 1e-6, "x", size_um), log)
    assert (found.effect == "structure-drift") == kept
    if not kept:
        assert found.effect == "unnamed"
        assert f"beside it {size_um:.1f} um are left that follow the same" in found.statement
        assert SAID.statement in found.statement


def test_nothing_left_leaves_the_name() -> None:
    assert checked_remainder(SAID, GROWTH, None, DecisionLog()) is SAID
