"""What the diagnosis tries: the same columns and scores on any number of cores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from errormodel.conventions import MOTIONS
from errormodel.effects.cross_axis_compliance import CrossAxisCompliance
from errormodel.schema import read_machine
from errormodel.survey import read_survey
from identification import side_by_side
from identification.diagnosis.candidates import MANY, Candidates
from identification.diagnosis.workbench import set_up
from identification.fit.run import fit_machine
from tests.test_diagnosis_empty import empty_survey

GANTRY = Path(__file__).parents[1] / "machines/examples/gantry"


def test_cores_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = read_machine(GANTRY)
    bench = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    counts = (1, 2, 3) if side_by_side.cores() > 1 else (1,)
    found = []
    for count in counts:
        monkeypatch.setattr(side_by_side, "cores", lambda count=count: count)
        found.append(Candidates.of(bench))
    one, *others = found
    assert len(one.effects) > MANY
    scores = one.scores(bench)
    for other in others:
        assert other.effects == one.effects
        for block, same in zip(one.blocks, other.blocks, strict=True):
            np.testing.assert_array_equal(block.numbers, same.numbers)
            np.testing.assert_array_equal(block.columns, same.columns)
            np.testing.assert_array_equal(block.sizes, same.sizes)
        for name in ("evidence", "drop", "absorbed", "reach"):
            np.testing.assert_array_equal(getattr(other.scores(bench), name), getattr(scores, name))


def test_candidates_are_columns_of_their_effects_at_their_usual_sizes() -> None:
    """As they are kept, phases of waves among them in single precision, beside each effect's own in double."""
    machine = read_machine(GANTRY)
    bench = set_up(fit_machine(machine, read_survey(GANTRY / "survey.csv", machine)))
    candidates = Candidates.of(bench)
    for block in candidates.blocks[::5]:
        for n, kept, usual in list(zip(block.numbers, block.columns, block.sizes, strict=True))[::40]:
            columns, sizes = bench.columns(candidates.effects[n])
            np.testing.assert_array_equal(usual, sizes)
            exact = columns * sizes[:, None]
            np.testing.assert_allclose(kept, exact, rtol=0, atol=2e-5 * max(np.abs(exact).max(), 1e-300))


@pytest.mark.parametrize("name", ["trunnion_five_axis", "fork_head_five_axis", "five_axis_table_quill"])
def test_no_compliance_is_another_joints_geometry(name: str) -> None:
    """A translation that no turn between two joints changes is an error motion of either; one that is turned is not."""
    machine = read_machine(name)
    bench = set_up(fit_machine(machine, empty_survey(machine, 300, 3, channels=False, grid=False)))
    said = {(e.joint, e.other, e.motion) for e in CrossAxisCompliance.proposals(bench.scene)}
    names = [j.name for j in machine.joints]
    for joint, other in ((a, b) for a in names for b in names if a != b):
        own = np.array(bench.levers[other][:3])
        for k in range(3):
            lever = np.asarray(bench.levers[joint][k])
            same = np.linalg.lstsq(own.T, lever, rcond=None)[0] @ own
            assert ((joint, other, MOTIONS[k]) in said) == (not np.allclose(same, lever, atol=1e-6))
