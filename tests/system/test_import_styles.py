"""A tracker's list in any style, joined with a programme, is the survey that it is in plain form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from identification import import_survey
from tests.helpers.importing import MILL, points, poses, programme
from tests.helpers.raw_files import STYLES, Style, written

COMMANDS = poses(rows=12)
MEASURED = points(COMMANDS)
MM_A_UNIT = {"mm": 1.0, "m": 1e3, "inch": 25.4}
JOINED = STYLES.filter(
    lambda s: not (s.comma and s.delimiter == ",") and not (s.names == "comment" and s.units == "row")
)


@pytest.mark.long
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(style=JOINED, unit=st.sampled_from([*MM_A_UNIT]), numbered=st.booleans())
def test_the_survey_is_the_same_in_every_style(style: Style, unit: str, numbered: bool, tmp_path: Path) -> None:
    stated = style.units != "none" and style.names != "none"
    size = MM_A_UNIT[unit] if stated else 1.0
    values = (MEASURED / size).tolist()
    rows = [[f"P{k}", *row] for k, row in enumerate(values)] if numbered else values
    names, units = ("X", "Y", "Z"), (unit,) * 3
    if numbered:
        names, units = ("Point", *names), ("-", *units)
    (tmp_path / "list.txt").write_bytes(written(style, names, units, rows))
    (tmp_path / "survey.nc").write_text(programme(COMMANDS))
    survey = import_survey(tmp_path / "list.txt", MILL, commands=tmp_path / "survey.nc").survey
    np.testing.assert_array_equal(survey.commands(["X", "Y", "Z"]), COMMANDS.to_numpy())
    np.testing.assert_allclose(survey.measured, MEASURED, atol=1e-9)
