"""The interruption of this process by a signal, kept from its handler on: a library may lose it on its way."""

from __future__ import annotations

_came: list[KeyboardInterrupt] = []


def interrupted_by(number: int) -> KeyboardInterrupt:
    """The interruption by a signal of some number, which is kept."""
    _came.append(KeyboardInterrupt(number))
    return _came[-1]


def came() -> KeyboardInterrupt | None:
    """The interruption of this process, once a signal came."""
    return _came[-1] if _came else None
