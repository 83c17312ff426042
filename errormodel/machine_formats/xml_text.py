"""XML as plain elements with their lines; document types and entities are refused, so that nothing expands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import RawFile

DEEPEST = 100  # levels of elements; by judgement
MOST_ELEMENTS = 200_000  # by judgement: the largest published descriptions have some thousands


@dataclass(frozen=True)
class Element:
    """An element: its tag, attributes, line (from 1), the elements in it, and its first byte in UTF-8."""

    tag: str
    attributes: Mapping[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    start: int = 0

    def all(self, tag: str) -> Iterator[Element]:
        """The elements directly in it that have that tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first element directly in it that has that tag, if there is one."""
        return next(self.all(tag), None)

    def walk(self) -> Iterator[Element]:
        """It and all elements in it."""
        stack = [self]
        while stack:
            element = stack.pop()
            yield element
            stack += reversed(element.children)


def parse_xml(raw: RawFile) -> Element:
    """The root element of a file.

    Raises
    ------
    InputError
        It is no XML, or has a document type or entities.
    """
    parser = expat.ParserCreate(encoding="utf-8")
    root = Element("", {}, 1)
    stack, count = [root], 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(stack) > DEEPEST or count > MOST_ELEMENTS:
            raise InputError(
                f"{raw.name}, line {parser.CurrentLineNumber}",
                f"more than {DEEPEST} levels or {MOST_ELEMENTS} elements",
                "Give the description of one machine",
            )
        element = Element(tag, attributes, parser.CurrentLineNumber, start=parser.CurrentByteIndex)
        stack[-1].children.append(element)
        stack.append(element)

    def refuse(*_: object) -> None:
        where = f"{raw.name}, line {parser.CurrentLineNumber}"
        raise InputError(where, "a document type or an entity, which is not read", "Remove it")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse((raw.text or "").encode("utf-8"), True)
    except expat.ExpatError as error:
        words = expat.ErrorString(error.code)
        where = f"{raw.name}, line {error.lineno}"
        raise InputError(where, f"no XML: {words}", "Give the file as it was written") from error
    return root.children[0]
