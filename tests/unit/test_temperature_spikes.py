"""Single readings of a temperature that jump off and back are gaps, with a note; a loose sensor stays as read."""

from __future__ import annotations

import numpy as np
import pandas as pd

from errormodel.surveys.gaps import filled

ROWS = 60


def survey(**sensors: object) -> pd.DataFrame:
    rows = np.arange(ROWS)
    return pd.DataFrame({"file": "s.csv", "role": "fit", "run": "1", "row": rows + 1, "time": 40.0 * rows, **sensors})


def warm() -> np.ndarray:
    return 20 + 0.05 * np.arange(ROWS)


def test_a_single_jump_of_a_sensor_is_no_reading() -> None:
    """A loose plug reads 85 degC twice; a nozzle may be as hot, and what stays there was not loose."""
    spoilt = warm()
    spoilt[[7, 30]] = 85.0
    step = warm() + np.where(np.arange(ROWS) < 20, 0.0, 40.0)
    table, notes = filled(survey(T_x=spoilt, T_nozzle=spoilt, T_step=step))
    assert notes[0].startswith("s.csv: T_x jumps to 85 degC and back within 300 s in 2 rows (8, 31)")
    np.testing.assert_allclose(table["T_x"], warm(), atol=1e-9)
    np.testing.assert_allclose(table["T_nozzle"], spoilt)
    np.testing.assert_allclose(table["T_step"], step)
    assert not any("T_nozzle" in note or "T_step" in note for note in notes)


def test_what_may_have_cooled_meanwhile_is_a_reading() -> None:
    spoilt = warm()
    spoilt[30] = 85.0
    slow = survey(T_x=spoilt).assign(time=600.0 * np.arange(ROWS))
    for table in (slow, slow.drop(columns="time")):
        np.testing.assert_allclose(filled(table)[0]["T_x"], spoilt)


def test_a_sensor_that_jumps_all_the_time_is_left_as_it_was_read() -> None:
    spoilt = warm()
    spoilt[3:36:3] = 85.0
    table, notes = filled(survey(T_x=spoilt))
    np.testing.assert_allclose(table["T_x"], spoilt)
    assert not notes
