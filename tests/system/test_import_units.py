"""Points whose unit or hand is wrong, or that belong to other commands: named, with what to write."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError
from identification import import_survey
from tests.helpers.importing import MILL, ROWS, points, poses, programme, spatialanalyzer

COMMANDS = poses()
MEASURED = points(COMMANDS)


@pytest.mark.long
@pytest.mark.parametrize("match", ["auto", "nearest"])
@pytest.mark.parametrize(
    ("changed", "found", "cure"),
    [
        (1 / 25.4, "in inch 30 of 30 readings fit", "--units mx=inch"),
        (np.array([1, -1, 1]), "as their mirror image 30 of 30 readings fit", "--columns mz=-Z"),
        (np.array([1, 1, -1]) / 1e3, "in m and as their mirror image 30 of 30", "--units mx=m"),
    ],
)
def test_the_unit_and_the_hand_of_points_in_no_order_are_named(
    match: Literal["auto", "nearest"], changed: float | np.ndarray, found: str, cure: str, tmp_path: Path
) -> None:
    order = np.random.default_rng(4).permutation(30)
    rows = "\n".join("\t".join(f"{v:.7f}" for v in MEASURED[k] * changed) for k in order)
    (tmp_path / "bare.txt").write_text(rows)
    COMMANDS[:30].to_csv(tmp_path / "few.csv", index=False)
    with pytest.raises(InputError) as error:
        import_survey(tmp_path / "bare.txt", MILL, commands=tmp_path / "few.csv", match=match)
    assert found in str(error.value)
    assert cure in str(error.value)
    assert ("add --match nearest" in str(error.value)) is (match == "auto")


@pytest.mark.parametrize("separate", [False, True])
def test_the_unit_that_is_advised_is_the_right_one(separate: bool, tmp_path: Path) -> None:
    """Of columns whose unit the file states wrongly, named one by one: what a file states goes before a kind's unit."""
    both = pd.DataFrame(np.hstack([COMMANDS, MEASURED]), columns=["X", "Y", "Z", "mx", "my", "mz"])
    (head, rows) = both.to_csv(index=False).split("\n", 1)
    (tmp_path / "both.csv").write_text(head.replace("X,Y,Z", "X [in],Y [in],Z [in]") + "\n" + rows)
    words = {"commands": tmp_path / "both.csv"} if separate else {}
    (tmp_path / "m.csv").write_text(both[["mx", "my", "mz"]].to_csv(index=False))
    source = tmp_path / ("m.csv" if separate else "both.csv")
    option = "--command-units" if separate else "--units"
    with pytest.raises(InputError, match=rf"only if they are in mm\. Import again with {option} X=mm,Y=mm,Z=mm$"):
        import_survey(source, MILL, **words)
    units = dict.fromkeys("XYZ", "mm")
    said = {"command_units": units} if separate else {"units": units}
    np.testing.assert_allclose(import_survey(source, MILL, **words, **said).survey.table[[*"XYZ"]], COMMANDS)


@pytest.mark.parametrize(("wrong", "accepted"), [(3, True), (8, False)])
def test_more_than_a_few_points_of_other_commands_are_refused(wrong: int, accepted: bool, tmp_path: Path) -> None:
    """As after a clock that was set: what is joined from there on was measured elsewhere. A few are gross errors."""
    other = points(poses(seed=11))
    mixed = np.vstack([MEASURED[: ROWS - wrong], other[ROWS - wrong :]])
    (tmp_path / "survey.nc").write_text(programme(COMMANDS))
    (tmp_path / "mixed.txt").write_text(spatialanalyzer(mixed))
    if accepted:
        said = import_survey(tmp_path / "mixed.txt", MILL, commands=tmp_path / "survey.nc").summary()
        assert "far from their commands: rows 38, 39, 40" in said
        return
    with pytest.raises(InputError, match=r"joined rows 33 to 40: 8 of 40 points lie .*or a clock was set"):
        import_survey(tmp_path / "mixed.txt", MILL, commands=tmp_path / "survey.nc")
