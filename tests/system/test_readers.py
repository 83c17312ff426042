"""Any bytes, in any file that is read: taken, or refused in words; never another exception, never slowly."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.helpers.nightly import first_of
from tests.helpers.reading import readers, tried

WORDS = (
    b"", b"nan", b"-1", b"1e308", b"1e-320", b"0", b"9" * 400, b"\0", b"\xff\xfe", b"\n", b",", b";", b"'", b'"', b"[",
    b"]", b"{", b"}", b":", b"null", b"true", b"X", b"=1", b"\xef\xbb\xbf", b"&a", b"*a", b"!!int", b"\t", b"\r", b"-",
    b"1000000000000", b"dx", b"\\ud800", b"..", b"%",
)  # fmt: skip
RAW = [name for name in readers() if name.startswith("raw ")]  # which a test of all raw formats tries every time too
OTHERS = [name for name in readers() if name not in RAW]


@st.composite
def mutated(draw: st.DrawFn, sound: bytes) -> bytes:
    """A sound content after a few changes: parts cut, doubled, moved or replaced by words that readers trip over."""
    data = sound
    for _ in range(draw(st.integers(1, 4))):
        a, b = sorted((draw(st.integers(0, len(data))), draw(st.integers(0, len(data)))))
        b = min(b, a + draw(st.sampled_from((0, 1, 2, 5, 40, 100_000))))
        kind = draw(st.integers(0, 3))
        middle = {0: b"", 1: 2 * data[a:b], 2: draw(st.sampled_from(WORDS)), 3: draw(st.binary(max_size=6))}[kind]
        data = data[:a] + middle + data[b:]
    return data


@pytest.mark.parametrize("name", readers())
def test_the_sound_file_is_read(name: str) -> None:
    if name != "compressed pcd":  # its header only; what follows is no compressed data
        assert tried(name, readers()[name].sound)


@pytest.mark.parametrize("name", first_of([*OTHERS, *RAW], len(OTHERS)))
@given(data=st.data())
# a sample: .ci/run tries 230 inputs for each reader by `tests.benchmarks.fuzz`, which knows what they have reached
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_any_bytes(name: str, data: st.DataObject) -> None:
    tried(name, data.draw(mutated(readers()[name].sound)))
