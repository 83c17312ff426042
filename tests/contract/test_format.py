"""What every format of survey tables keeps to: its suffixes, what it opens, and refusals instead of crashes."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.formats import SUFFIXES, module_of, open_tables

WRITERS: dict[str, Callable[[pd.DataFrame, Path], object]] = {  # what others write; one of the user's has none here
    ".csv": lambda frame, path: frame.to_csv(path, index=False),
    ".tsv": lambda frame, path: frame.to_csv(path, index=False, sep="\t"),
    ".txt": lambda frame, path: frame.to_csv(path, index=False, sep=";"),
    ".dat": lambda frame, path: frame.to_csv(path, index=False, sep="\t"),
    ".parquet": lambda frame, path: frame.to_parquet(path),
    ".pq": lambda frame, path: frame.to_parquet(path),
}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_says_what_it_is(suffix: str) -> None:
    module = module_of(suffix)
    assert suffix in module.SUFFIXES
    assert suffix.startswith(".")
    assert suffix == suffix.lower()
    assert (inspect.getdoc(module) or "").strip()
    assert list(inspect.signature(module.open_table).parameters) == ["path", "name"]


@pytest.mark.parametrize("suffix", [s for s in SUFFIXES if s in WRITERS])
def test_numbers_gaps_and_texts_come_back(suffix: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    frame = pd.DataFrame({"X": rng.uniform(-500, 500, 30), "mx": rng.normal(size=30), "run": ["a", "b"] * 15})
    frame.loc[[3, 17], "mx"] = np.nan
    path = tmp_path / f"data{suffix}"
    WRITERS[suffix](frame, path)
    (table,) = open_tables(path, path.name)
    assert set(table.columns) == {"X", "mx", "run"}
    read, _ = table.read(["X", "mx"], ["run"])
    np.testing.assert_array_equal(read[["X", "mx"]].to_numpy(dtype=float), frame[["X", "mx"]].to_numpy())
    assert list(read["run"]) == list(frame["run"])
    assert list(read.index) == list(range(30))
    assert f"{path.name}, row 4" in table.cell(3, "mx")


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=300))
def test_any_bytes_are_opened_or_refused_never_a_crash(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"data{suffix}"
    path.write_bytes(content)
    with contextlib.suppress(InputError):
        (table,) = open_tables(path, path.name)
        table.read(table.columns[:1], table.columns[1:])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_not_there_is_named(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        open_tables(tmp_path / f"none{suffix}", f"none{suffix}")


def test_a_name_is_looked_for_among_all_files_of_a_folder(tmp_path: Path) -> None:
    """However many, and in whatever order the disk lists them."""
    for k in range(30):
        (tmp_path / f"m{k:02d}.csv").touch()
    cure = r"Did you mean 'm27\.csv'\? Valid: m00\.csv, .*, m19\.csv and 10 more$"
    with pytest.raises(InputError, match=rf"m27csv: no such file\. {cure}"):
        open_tables(tmp_path / "m27csv", "m27csv")
