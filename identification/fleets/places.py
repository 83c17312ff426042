"""Where the inputs of a fleet are: folders of this computer, or any store that fsspec knows."""

from __future__ import annotations

import posixpath
import re
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from errormodel.exceptions import InputError

ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(::[A-Za-z][A-Za-z0-9+.-]+)*://")  # a letter alone is a drive
SETTINGS = (".yaml", ".yml")  # a survey of this suffix names files beside it
_one_reader = Lock()


@dataclass(frozen=True)
class Base:
    """The folder of a list, and the name of the list in it.

    Attributes
    ----------
    folder : a path, or an address with its protocol.
    """

    folder: str
    last: str

    @classmethod
    def of(cls, source: str) -> Base:
        if is_address(source):
            store, inside, around = _split(source)
            folder, _, last = inside.rpartition("/")
            return cls(store + folder + around, last)
        path = Path(source)
        return cls(str(path.parent.absolute()), path.name)

    def place(self, entry: str) -> str:
        """Path or address of an entry of the list."""
        if is_address(entry):
            return entry
        if is_address(self.folder):
            store, path, around = _split(self.folder)
            return store + posixpath.normpath(posixpath.join(path, entry.lstrip("/"))) + around
        return str(Path(self.folder) / entry)


def _split(address: str) -> tuple[str, str, str]:
    """Store, path in it, and what the store itself lies in: ``zip://``, ``a/list.csv``, ``::s3://shop/fleet.zip``."""
    found = ADDRESS.match(address)
    assert found is not None
    path, colons, around = address[found.end() :].partition("::")
    return found.group(), path, colons + around


def is_address(text: str) -> bool:
    """Whether a text is an address of a store and no path of this computer."""
    return ADDRESS.match(text) is not None


@contextmanager
def fetched(base: Base, entry: str, *, with_folder: bool = False) -> Iterator[Path]:
    """Path of an entry on this computer, for the time of the block.

    What is in a store is copied. Of a survey.yaml its whole folder is, since it names files in it.

    Parameters
    ----------
    with_folder : whether a file of settings brings the files beside it.

    Raises
    ------
    InputError
        It is not there, or its store is not known.
    """
    place = base.place(entry)
    if not is_address(place):
        yield Path(place)
        return
    system, inside = _system(place)
    with tempfile.TemporaryDirectory(prefix="errormodel-") as space:
        name = inside.rstrip("/").rpartition("/")[2]
        target = Path(space) / name
        try:
            with _turn(system):
                if system.isdir(inside):
                    _copy(system, inside, target)
                elif with_folder and name.lower().endswith(SETTINGS):
                    _copy(system, inside.rpartition("/")[0], Path(space))
                else:
                    system.get_file(inside, str(target))
        except FileNotFoundError as error:
            raise InputError(place, "no such file", "Correct the path in the list, or put the file there") from error
        except OSError as error:
            raise InputError(place, f"cannot be read: {error}", "Give a file that can be read") from error
        yield target


def _turn(system: Any) -> AbstractContextManager[Any]:
    """Stores may be read by several threads at once only where they are asynchronous.

    fsspec's memory, for one, hands out a file as one object with one position: two readers get pieces of it.
    """
    return nullcontext() if getattr(system, "async_impl", False) else _one_reader


def _copy(system: Any, folder: str, target: Path) -> None:
    for found in system.find(folder):
        own = target / posixpath.relpath(found, folder)
        own.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(found, str(own))


def _system(place: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError as error:
        cure = "Install it (pip install 'errormodel[fleet]'), or copy the files to this computer"
        raise InputError(place, "fsspec, which reads from stores, is not installed", cure) from error
    try:
        system, inside = fsspec.core.url_to_fs(place)
    except (ImportError, ValueError, OSError) as error:
        raise InputError(
            place, f"this store cannot be opened ({error})", "Install what it needs, or correct it"
        ) from error
    return system, inside
