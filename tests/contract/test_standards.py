"""What every standard has, and that no other module knows one of them."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

from errormodel.exceptions import InputError
from identification import standards
from identification.iso_standards import registry, standard
from tests.helpers.sources import source

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "identification.iso_standards"


@pytest.mark.parametrize("number", registry())
def test_every_standard_has_a_title_and_a_source(number: str) -> None:
    kind = registry()[number]
    assert kind.number in kind.title or "ISO 230-1" in kind.title
    survey, fit = kind.takes()
    assert survey or fit
    assert bool(kind.needs) == survey  # the words of a refusal
    assert inspect.getdoc(inspect.getmodule(kind))
    assert number in standards()


def test_numbers_may_be_spelled_as_people_do() -> None:
    for text in ("230-2", "ISO 230-2", "iso 230-2:2014", " ISO230-2 "):
        assert standard(text).number == "230-2"
    with pytest.raises(InputError, match="Valid: 10360-2"):
        standard("9283")


def test_no_module_imports_one_standard() -> None:
    files = {Path(inspect.getfile(kind)).stem for kind in registry().values()}
    seen = []
    for path in [*(ROOT / "errormodel").rglob("*.py"), *(ROOT / "identification").rglob("*.py")]:
        for module in source(path).imported:
            seen += [f"{path.name}: {module}" for f in files if module == f"{PACKAGE}.{f}"]
    assert seen == []
