"""Ranges of the rows of a table are what the whole table has there; what may be read differently is refused."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.formats import csv_ranges, open_tables
from errormodel.formats.base import Table

NUMBERS, TEXTS = ["X", "mx"], ["run"]


def table(n: int) -> pd.DataFrame:
    rng = np.random.default_rng(n)
    mx = np.where(rng.random(n) < 0.1, np.nan, rng.normal(size=n))
    return pd.DataFrame({"X": 100 * rng.normal(size=n), "run": [f"r{k % 3}" for k in range(n)], "mx": mx})


def written(folder: Path, n: int, kind: str) -> Table:
    path = folder / ("a.parquet" if kind == "parquet" else "a.csv")
    if kind == "parquet":
        table(n).to_parquet(path, index=False, row_group_size=max(1, n // 3))
    else:
        text = table(n).to_csv(index=False)
        text = text.replace("\n", "\r\n") if kind == "crlf" else text
        text = text + "\n\r\n\n" if kind == "empty lines" else text
        path.write_text(text.rstrip("\n") if kind == "no end" else text, newline="")
    return open_tables(path, path.name)[0]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=st.data(),
    n=st.integers(1, 70),
    kind=st.sampled_from(["parquet", "plain", "crlf", "empty lines", "no end"]),
    marks=st.sampled_from([1, 4, 16, 1 << 14]),
    scanned=st.sampled_from([7, 64, 1 << 23]),
)
def test_a_range_is_what_the_whole_has_there(
    data: st.DataObject, n: int, kind: str, marks: int, scanned: int, tmp_path: Path
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv_ranges, "_MARK_ROWS", marks)
        patch.setattr(csv_ranges, "_SCANNED_BYTES", scanned)
        whole = written(tmp_path, n, kind)
        ranges = pickle.loads(pickle.dumps(whole.in_ranges()))
        assert len(ranges) == n
        expected, _ = whole.read(NUMBERS, TEXTS)
        for _ in range(4):  # in any order, through one reader
            start = data.draw(st.integers(0, n - 1))
            stop = data.draw(st.integers(start + 1, n))
            part, _ = ranges.rows(start, stop).read(NUMBERS, TEXTS)
            pd.testing.assert_frame_equal(part, expected.iloc[start:stop], check_index_type=False)


def test_without_pyarrow_the_same_numbers_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = written(tmp_path, 50, "plain")
    fast, _ = whole.in_ranges().rows(10, 30).read(NUMBERS, TEXTS)
    monkeypatch.setattr("errormodel.formats.csv_file.read_plain", lambda *_: None)
    slow, _ = whole.in_ranges().rows(10, 30).read(NUMBERS, TEXTS)
    pd.testing.assert_frame_equal(fast, slow)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('X,mx,run\n1,2,"a"\n', "quotation marks"),
        ("X,mx,run\n1,2,a\n\n3,4,a\n", "an empty line between rows"),
        ("X;mx;run\n1,5;2,5;a\n", "decimal commas"),
        ("X,mx,run\n", "no rows"),
    ],
)
def test_what_may_be_read_differently_is_refused(tmp_path: Path, text: str, found: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=found):
        open_tables(path, "a.csv")[0].in_ranges().rows(0, 1).read(NUMBERS, TEXTS)


def test_a_wrong_row_is_named_by_its_number_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(table(40).to_csv(index=False) + "1,2\n")
    ranges = open_tables(path, "a.csv")[0].in_ranges()
    with pytest.raises(InputError, match=r"row 41 \(line 42\).*2 fields"):
        ranges.rows(30, 41).read(NUMBERS, TEXTS)


def test_a_pattern_names_the_parts_of_a_table(tmp_path: Path) -> None:
    for k in (10, 2):
        table(k).to_csv(tmp_path / f"part{k}.csv", index=False)
    table(5).to_csv(tmp_path / "other.csv", index=False)
    assert [t.name for t in open_tables(tmp_path / "part*.csv", "runs/part*.csv")] == [
        "runs/part2.csv",
        "runs/part10.csv",
    ]
    with pytest.raises(InputError, match="no such file"):
        open_tables(tmp_path / "none*.csv", "none*.csv")


def test_threads_read_side_by_side(tmp_path: Path) -> None:
    """A worker with several threads has one opened survey for all of them."""
    whole = written(tmp_path, 4000, "parquet")
    ranges, expected = whole.in_ranges(), whole.read(NUMBERS, TEXTS)[0]

    def part(k: int) -> pd.DataFrame:
        return pd.concat([ranges.rows(a, a + 7).read(NUMBERS, TEXTS)[0] for a in range(500 * k, 500 * k + 490, 7)])

    with ThreadPoolExecutor(4) as threads:
        for k, found in enumerate(threads.map(part, range(8))):
            pd.testing.assert_frame_equal(found, expected.iloc[500 * k : 500 * k + 490], check_index_type=False)
