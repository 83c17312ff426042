"""Corrected programmes: positions that are sent, words that stay, lines that are divided, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.controllers.gcode import GCode
from errormodel.exceptions import InputError
from tests.chains import Array
from tests.setups import plain_setup

SETUP = plain_setup()
G = GCode()


def shift(q: Array, came: Array) -> Array:
    """A correction that differs along each axis: 10 um, 100 um/m and a bow of Z along X."""
    return q + np.column_stack([np.full(len(q), 0.01), 1e-4 * q[:, 0], 1e-6 * q[:, 0] ** 2])


def sent(text: str) -> Array:
    return G.positions("a.nc", text, SETUP)


def rewritten(text: str) -> str:
    return G.rewrite("a.nc", text, SETUP, shift)


def test_positions_are_corrected_and_other_words_stay() -> None:
    text = "%\nN10 G90 G21 G17\nN20 G0 X0 Y10 Z-60 (first)\nN30 G1 X100 F500 M8\nM5\nN40 Z-61\nM30\n%\n"
    out = rewritten(text)
    lines = out.splitlines()
    assert lines[0] == lines[-1] == "%"
    assert lines[1] == "N10 G90 G21 G17"
    assert "(first)" in out
    assert "M5" in lines
    assert next(line for line in lines if "N30" in line).startswith("N30 G1 F500 M8 X")
    asked = np.array([[0, 10, -60], [100, 10, -60], [100, 10, -61]], dtype=float)
    ends = sent(out)
    wanted = shift(asked, asked)
    for target in wanted:
        assert np.abs(ends - target).max(axis=1).min() <= G.quantum(SETUP) + 1e-12


def test_a_cut_along_one_axis_moves_the_others_too_and_is_divided_where_the_correction_bends() -> None:
    ends = sent(rewritten("G0 X-200 Y0 Z-60\nG1 X400\n"))[1:]
    assert len(ends) > 10
    x = ends[:, 0] - 0.01
    np.testing.assert_allclose(ends[:, 1], 1e-4 * x, atol=1e-4)
    middle = (x[1:] + x[:-1]) / 2
    chord = (ends[1:, 2] + ends[:-1, 2]) / 2
    assert np.abs(chord - (-60 + 1e-6 * middle**2)).max() < 4e-4
    assert len(sent(rewritten("G0 X-200 Y0 Z-60\nG0 X400\n"))) == 2  # rapids are not


def test_arcs_become_chords_on_the_circle() -> None:
    ends = sent(rewritten("G0 X50 Y0 Z-60\nG3 X0 Y50 I-50 J0 F100\nG2 X50 Y0 I0 J-50\n"))
    back = ends - (shift(ends, ends) - ends)
    assert len(ends) > 50
    np.testing.assert_allclose(np.hypot(back[:, 0], back[:, 1]), 50, atol=1e-3)
    assert ends[len(ends) // 4, 1] > 10  # counter-clockwise
    assert "G3" not in rewritten("G0 X50 Y0 Z-60\nG3 X0 Y50 I-50 J0 F100\n")
    full = sent(rewritten("G0 X50 Y0 Z-60\nG2 X50 Y0 I-50 J0\n"))
    assert np.ptp(full[:, 0]) == pytest.approx(100, abs=0.1)


def test_an_offset_says_where_the_axes_stand() -> None:
    plain, offset = (sent(rewritten(f"{head}G0 X0 Y10 Z-60\n"))[-1] for head in ("", "(ERRORMODEL OFFSET X100 Z5)\n"))
    np.testing.assert_allclose(plain, [0.01, 10, -60], atol=1e-4)
    np.testing.assert_allclose(offset[:2], [100.01, 10.01], atol=1e-4)  # in axes: the reader adds the offset itself


def test_machine_coordinates_and_codes_without_a_path_stay_as_they_are() -> None:
    text = "G0 X0 Y10 Z-60\nG53 G0 Z0\nG28 X0\nG4 P2\nG92 X3\n"
    assert rewritten(text).splitlines()[1:] == text.splitlines()[1:]


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("G91 X1", "increments"),
        ("G20", "inches"),
        ("G41 D1", "cutter radius"),
        ("G81 Z-70 R-55", "canned cycle"),
        ("G43.4 H1", "tool centre point"),
        ("TRAORI", "tool centre point"),
        ("G2 X10 Y10 R5", "an arc without a centre"),
    ],
)
def test_what_changes_the_path_in_the_control_is_refused(line: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as error:
        rewritten(f"G0 X0 Y0 Z-60\n{line}\n")
    assert "line 2" in str(error.value)


def test_tables_of_commands() -> None:
    out = G.rewrite("a.csv", "X,Y,Z\n100,20,-60\n-50,20,-60\n", SETUP, shift)
    np.testing.assert_allclose(
        G.positions("a.csv", out, SETUP), [[100.01, 20.01, -59.99], [-49.99, 19.995, -59.9975]], atol=1e-9
    )
    with pytest.raises(InputError, match="columns X, Q"):
        G.rewrite("a.csv", "X,Q\n1,2\n", SETUP, shift)
    with pytest.raises(InputError, match="line 3"):
        G.rewrite("a.csv", "X,Y,Z\n1,2,3\n1,b,3\n", SETUP, shift)


def test_directions_of_arrival_are_told_to_the_correction() -> None:
    seen: list[Array] = []

    def note(q: Array, came: Array) -> Array:
        seen.append(came)
        return q

    G.rewrite("a.nc", "G0 X0 Y10 Z-60\nG0 X50\nG0 Y5\nG0 X20\n", SETUP, note)
    assert [came[-1, 0] for came in seen] == [1, 1, 1, -1]
    assert [came[-1, 1] for came in seen] == [1, 1, -1, -1]
