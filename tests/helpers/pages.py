"""An HTML page as tests read it."""

from __future__ import annotations

import re
from html.parser import HTMLParser


class Page(HTMLParser):
    """Elements with their attributes, and the text of table cells and headings."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.headings: dict[str, str] = {}
        self._open: list[str] = []
        self._rows: list[list[str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attributes}
        self.elements.append((tag, values))
        if tag not in ("meta", "img"):
            self._open.append(tag)
        if tag == "table":
            self._rows = self.tables[values["id"]] = []
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("th", "td"):
            self._rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag  # everything is closed, in order

    def handle_data(self, data: str) -> None:
        for tag in ("th", "td"):
            if tag in self._open:
                self._rows[-1][-1] += data
        if self._open and re.fullmatch("h[1-6]|title", self._open[-1]):
            self.headings.setdefault(self._open[-1], "")
            self.headings[self._open[-1]] += data
