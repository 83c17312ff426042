"""A page from its template, with the figures in it: all are drawn last."""

from __future__ import annotations

import secrets
from functools import cache
from typing import TYPE_CHECKING

from identification.report.pictures import Picture

if TYPE_CHECKING:
    import jinja2


def page(template: str, **parts: object) -> str:
    """Self-contained HTML of a template."""
    album = Album()
    return album.filled(environment().get_template(template).render(album=album, **parts))


class Album:
    """Figures of a page; a placeholder stands for each until it is drawn."""

    def __init__(self) -> None:
        self._word = secrets.token_hex(8)  # random, so that no user's text contains it
        self._placed: list[Picture] = []

    def place(self, picture: Picture) -> str:
        """Placeholder of a figure."""
        self._placed.append(picture)
        return self._stand_in(len(self._placed) - 1)

    def filled(self, text: str) -> str:
        """The text with all figures."""
        for k, picture in enumerate(self._placed):
            text = text.replace(self._stand_in(k), picture.source())
        return text

    def _stand_in(self, number: int) -> str:
        return f"{self._word}-{number}."


@cache
def environment() -> jinja2.Environment:
    """Template environment; templates are compiled on first use."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.PackageLoader("identification.report"),
        autoescape=True,  # names of machines, elements, runs and files are arbitrary text
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
