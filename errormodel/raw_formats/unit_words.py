"""Units as files of instruments write them, as words that `errormodel.units` knows."""

from __future__ import annotations

import re
from collections.abc import Iterable

from errormodel.units import INTERNAL_UNITS, is_unit

# other ways to write a unit, in lower case
_OTHER = {
    "°": "deg", "degree": "deg", "degrees": "deg", "degs": "deg", "deg.": "deg",
    "grad": "deg", "altgrad": "deg",  # German; the hundredth of a quarter turn is written gon
    "°c": "degC", "℃": "degC", "ºc": "degC", "c": "degC", "celsius": "degC", "deg c": "degC", "degc": "degC",
    "°f": "degF", "ºf": "degF", "f": "degF", "degf": "degF", "k": "K",
    "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometer": "um", "micrometre": "um",
    "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "in": "inch", "inches": "inch", '"': "inch",
    "µrad": "urad", "μrad": "urad", "radians": "rad", "radian": "rad", "arc sec": "arcsec", "sec": "s",
    "seconds": "s", "second": "s", "msec": "ms", "hours": "h", "minutes": "min", "mbar": "mbar", "hpa": "hPa",
    "%": "%", "% rh": "%", "%rh": "%",
}  # fmt: skip
# forms of dates and times of day in a row of units: hh:mm:ss, dd.mm.yyyy, TT.MM.JJJJ hh:mm
_CLOCK = re.compile(
    r"(?=.)(?:[dtjyam]{2,4}(?:[./-][dtjyam]{2,4}){2}[ T]?)?(?:h{1,2}:m{1,2}(?::s{1,2}(?:[.,][s0f]+)?)?)?", re.IGNORECASE
)
_BRACKETS = re.compile(r"^(.*?)\s*[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
_RATIO = re.compile(r"^(.+?)(?:\s*[/,]\s*|[\s_]+)([^/\s_]+/[^/\s]+)$")  # a unit with a slash of its own
_SLASH = re.compile(r"^(.+?)\s*/\s*([^/\s]+)$")
_OPEN = re.compile(r"[\[(<{][^\])>}]*$")  # a bracket that is not closed
_COMMA = re.compile(r"^(.+?),\s*([^,\s]+)$")
_BLANK = re.compile(r"^(.+?)\s+(mm|um|\u00b5m|\u03bcm|inch|deg|\u00b0|rad|mrad|urad|arcsec)$")
# a line above a table that states one unit for all of it
_STATED = re.compile(
    r"\b(?:units?|einheit(?:en)?|dimensions?|coordinates)\b(?: are| is)?(?: in)?\s*[:=,;\t ]\s*[\[(]?"
    r"([^\W\d]+)\b(?!/m\b)",
    re.IGNORECASE,
)
_TAIL = re.compile(r"^.+_(mm|um|inch|deg|rad|mrad|urad|arcsec|s|ms|degC|degF|K)$")


def unit_word(text: str) -> str:
    """The toolkit's word for a unit, or the text as it stands; nothing for the form of a date or a time of day."""
    text = text.strip().strip("[](){}<>").strip()
    if _CLOCK.fullmatch(text):
        return ""
    if text.count("/") == 1 and text.lower() not in _OTHER:
        ratio = "/".join(_OTHER.get(part.strip().lower(), part.strip()) for part in text.split("/"))
        return ratio if quantity_of_unit(ratio) else text
    return _OTHER.get(text.lower(), text)


def quantity_of_unit(unit: str) -> str:
    """The kind of a unit (``length``, ``angle`` ...), or an empty text."""
    return next((kind for kind in INTERNAL_UNITS if is_unit(unit, kind)), "")


def is_unit_word(text: str) -> bool:
    """Whether a cell of a row of units is one."""
    if not text.strip().strip("[](){}<>-").strip():
        return True
    word = unit_word(text)
    return not word or word in _OTHER.values() or bool(quantity_of_unit(word))


def bracketed(name: str) -> tuple[str, str]:
    """A column's name without the unit behind it, and that unit.

    ``X [mm]``, ``X (um/m)``, ``X / mm``, ``X, mm``, ``X mm``; of ``x_mm`` the name stays as it is.

    Brackets that hold no unit belong to the name: ``U(95)``.
    """
    for pattern in (_BRACKETS, _RATIO, _SLASH, _COMMA, _BLANK):
        match = pattern.match(name)
        whole = match is not None and (pattern is _BRACKETS or not _OPEN.search(match[1]))  # `Force (N/mm)` is no mm
        if match and whole and match[1].strip() and match[2].strip() and is_unit_word(match[2]):
            return match[1].strip(), unit_word(match[2])
    match = _TAIL.match(name)
    return name, match[1] if match else ""


def without_tail(name: str) -> str:
    """A column's name without a unit behind an underscore: ``x`` of ``x_mm``."""
    match = _TAIL.match(name)
    return name[: -len(match[1]) - 1] if match else name


def stated_length(lines: Iterable[str]) -> str:
    """The unit of length that lines above a table state for all of it; empty where none or several do."""
    words = {unit_word(match[1]) for line in lines for match in _STATED.finditer(line)}
    lengths = {word for word in words if quantity_of_unit(word) == "length"}
    return lengths.pop() if len(lengths) == 1 else ""
