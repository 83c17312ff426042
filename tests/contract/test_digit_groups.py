"""Numbers with separators between groups of digits: read where the file is clear, refused where it is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from tests.helpers.commands import MILL, XYZ

HEADER = "X;Y;Z;mx;my;mz\n"
ROW = "100,5;200,25;-50;{};200,27;-50,01\n"


def survey(folder: Path, *cells: str, other: str = "") -> list[float]:
    path = folder / "s.csv"
    path.write_text(HEADER + "".join(ROW.format(c) for c in cells) + other, encoding="utf-8")
    return [float(x) for x in read_survey(path, read_machine(MILL)).table[XYZ[0]]]


@pytest.mark.parametrize(
    ("cells", "values"),
    [
        (("1.234,5", "1.000", "999,75"), [1234.5, 1000.0, 999.75]),
        (("1.234.567", "12,5", "-1.000"), [1234567.0, 12.5, -1000.0]),
        (("1 234,5", "12,5", "1000"), [1234.5, 12.5, 1000.0]),
        (("1'234,5", "-1'000", "7"), [1234.5, -1000.0, 7.0]),
        (("1\u202f234,5", "12,5", "1\u00a0000"), [1234.5, 12.5, 1000.0]),
        (("0.100", "12.345", "1.5"), [0.1, 12.345, 1.5]),  # points elsewhere in the column are decimal signs
        (("12,345", "1,000", "1,5"), [12.345, 1.0, 1.5]),  # decimal commas of three decimals
    ],
)
def test_clear_ones_are_read(tmp_path: Path, cells: tuple[str, ...], values: list[float]) -> None:
    assert survey(tmp_path, *cells) == values


def test_groups_with_decimals_elsewhere_say_what_is_meant(tmp_path: Path) -> None:
    assert survey(tmp_path, "1.400", "1.700", other="1.100,5;0,5;0,5;2.000;0,5;0,5\n") == [1400.0, 1700.0, 2000.0]


def test_what_may_be_either_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"row 2 .* column mx: '1\.400' in a file with another decimal sign: 1400"):
        survey(tmp_path, "900", "1.400")


def test_a_bad_cell_is_named_and_not_its_good_neighbours(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"row 2 .* column mx: '12,5x' is not a number"):
        survey(tmp_path, "12,5", "12,5x")
