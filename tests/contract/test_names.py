"""One thing is one file: no other module of the product has the name of one effect, controller, instrument or format.

What others must know of a plug-in stands on its class. A list of names elsewhere is what a plug-in from outside, or the
next one in the tree, would have to be added to.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

from errormodel import formats, joint_models
from errormodel.controllers import registry as controllers
from errormodel.effects import registry as effects
from errormodel.instruments import instruments
from errormodel.machine_formats.base import registry as machine_formats
from errormodel.observations import registry as observations
from errormodel.raw_formats.base import raw_formats
from tests.helpers.sources import source

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = [p for package in ("errormodel", "identification") for p in sorted((ROOT / package).rglob("*.py"))]

KINDS = {
    "effects": effects(),
    "controllers": controllers(),
    "instruments": instruments(),
    "joint_models": joint_models.registry(),
    "raw_formats": raw_formats(),
    "machine_formats": machine_formats(),
    "observations": observations(),
}
# Where a name may stand outside its own file, and why.
ALLOWED = {
    "errormodel/gcode/codes.py": {"heidenhain"},  # a language of programmes, refused by name; not the controller
    "errormodel/gcode/detect.py": {"heidenhain"},  # the same
    "errormodel/effects/eccentricity.py": {"harmonic"},  # its own key, the number of the harmonic
    "errormodel/effects/wobble.py": {"harmonic"},  # the same
    "errormodel/effects/tracker_drift.py": {"warm-up"},  # of a tracker, in its source
    "identification/thermal_drift/recordings.py": {"warm-up"},  # a phase of a recording
    "identification/planning/setup.py": {"cmm"},  # an example in the description of a key
    "errormodel/surveys/file.py": {"cmm"},  # the same
    "errormodel/machine_file.py": {"ram-sag", "first-order"},  # the same, and what joints without an entry have
}


def named(text: str, words: set[str]) -> set[str]:
    """Words that a text is, or that stand in it: at once if they have a hyphen, which English has not."""
    before = {word: "" if "-" in word else r"(--controller|effect:|type:) " for word in words if word in text}
    inside = {w for w in before if re.search(rf"{before[w]}(?<![\w-]){re.escape(w)}(?![\w-])", text)}
    return inside | ({text} & words)


def test_the_search_for_names_finds_them() -> None:
    words = {"ram-sag", "cmm", "cmm-2"}
    for text, found in {
        "cmm": {"cmm"}, "a ram-sag of Z": {"ram-sag"}, "{type: cmm, at: 1}": {"cmm"}, "a cmm here": set(),
        "--controller cmm": {"cmm"}, "ram-sagging": set(), "type: cmm-2": {"cmm-2"}, "": set(),
    }.items():  # fmt: skip
        assert named(text, words) == found, text


@pytest.mark.parametrize("kind", KINDS)
def test_no_module_has_the_name_of_one_plug_in(kind: str) -> None:
    home = {word: Path(inspect.getfile(found)) for word, found in KINDS[kind].items()}
    seen = []
    for path in PRODUCT:
        words = {word for word, own in home.items() if own != path} - ALLOWED.get(str(path.relative_to(ROOT)), set())
        for line, text in source(path).texts:
            seen += [f"{path.relative_to(ROOT)}:{line}: {word}" for word in sorted(named(text, words))]
    assert seen == []


def test_no_module_of_surveys_has_the_suffix_of_one_format() -> None:
    """Other files may be of the same type (tables of a controller, clouds of points): those are no surveys."""
    surveys = [p for p in PRODUCT if p.name == "survey.py" or p.parent.name in ("surveys", "formats")]
    assert len(surveys) > 5
    own = {suffix: Path(formats.module_of(suffix).__file__ or "") for suffix in formats.SUFFIXES}
    seen = [
        f"{path.name}:{line}: {text}"
        for path in surveys
        for line, text in source(path).texts
        if text in own and own[text] != path
    ]
    assert seen == []


# Plug-ins that the product itself works with, and what for. All others are known by their base class only.
WORKED_WITH = {
    "axis_blunder",  # a mistake in a table: put right before anything else looks at the rows
    "clock_offset",  # the same, of its clock
    "station_shift",  # the same, of the zero of an instrument
    "unnamed",  # the form by which the diagnosis states what has no name
    "scale_expansion",  # what every axis may do at other temperatures, found or not
    "structure_drift",  # what the command for thermal models fits
    "target_offset",  # what a survey says of places that it does not know
    "plain",  # the instrument of a survey that names none
    "laser_tracker",  # a line of sight, looked for in residuals
}


def test_no_module_works_with_one_plug_in() -> None:
    """No module outside a kind's own folder imports one of its files, but for the few above."""
    home = {Path(inspect.getfile(found)) for kind in KINDS.values() for found in kind.values()}
    files = {".".join(p.relative_to(ROOT).with_suffix("").parts): p for p in home if p.is_relative_to(ROOT)}
    seen = []
    for path in PRODUCT:
        for module in source(path).imported:
            target = files.get(module)
            if target and path.parent != target.parent and target.stem not in WORKED_WITH:
                seen.append(f"{path.relative_to(ROOT)} imports {target.stem}")
    assert seen == []


KINDS_OF_FILES = (
    "effects", "controllers", "instruments", "formats", "joint_models", "observations", "machine_formats",
)  # fmt: skip
BASES = [f"{kind}/base.py" for kind in KINDS_OF_FILES]


@pytest.mark.parametrize("base", BASES)
def test_a_contract_imports_no_plug_in(base: str) -> None:
    path = ROOT / "errormodel" / base
    own = {Path(inspect.getfile(found)).stem for kind in KINDS.values() for found in kind.values()}
    own |= {"csv_file", "parquet_file", "klipper_probe"}
    imported = {module.split(".")[-1] for module in source(path).imported if module}
    assert not imported & own
