"""Manifest of a folder of results, ``manifest.json``: digests of its files and of the inputs they were made from.

It contains no dates and no absolute paths, so that the same input gives the same bytes everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from errormodel import __version__
from errormodel.exceptions import InputError
from errormodel.files import sha256
from errormodel.inputs import current
from identification.results.versions import read_json, validate

NAME = "manifest.json"  # file in each folder of results
SCHEMA = "errormodel.manifest/1"
CURE = "Choose another folder, or move it away"
PUT_BACK = "Put back what was written there, or run the command again with another folder"
ALWAYS = {  # files that every folder of a kind has, whatever the version and the options
    "model": ("machine.yaml", "parameters.csv", "residuals.csv", "covariance.csv", "fit.json"),
    "tables": ("checklist.txt", "compensation.json"),
    "evaluation": ("evaluation.json", "figures.csv", "certificate.html"),
    "fleet": ("fleet.json",),
    "part": ("part.json",),
    "survey": ("survey.yaml",),
}
SOMETIMES = ("diagnosis.json", "decisions.csv", "thermal.json")  # files that are read where they lie beside a fit
FOR_PEOPLE = (".html", ".svg", ".png")  # pages and figures, which no command reads


@dataclass(frozen=True)
class Manifest:
    """A manifest as read.

    Attributes
    ----------
    holds : "model" (fit, diagnose, thermal) or "tables" (compensate)
    files : digests by the paths in the folder, with /.
    inputs : digests by the names of the files that were read.
    made_by : what the folder holds, in words for a message.
    arguments, options : of the command; None as arguments where the version that wrote it kept none.
    version : of errormodel.
    """

    command: str
    holds: str
    files: Mapping[str, str]
    inputs: Mapping[str, list[str]]
    made_by: str
    arguments: Mapping[str, Any] | None
    options: Mapping[str, Any]
    version: str


def made_by(command: str, options: Mapping[str, Any]) -> str:
    """What a command writes, in words: the tables of a controller, or the results of the command."""
    if command == "compensate":
        return f"the tables of {options.get('name')}"
    return f"the results of `errormodel {command}`"


def written(folder: Path, holds: str) -> dict[str, Any]:
    """Manifest of all files in `folder`, as data, for the running command."""
    run = current()
    inputs = [{"name": p.name, "sha256": digest} for p, digest in run.inputs.items()] if run else []
    return {
        "schema": SCHEMA,
        "version": __version__,
        "holds": holds,
        "command": run.command if run else "",
        "arguments": run.arguments if run else {},
        "options": run.options if run else {},
        "inputs": sorted(inputs, key=lambda i: (i["name"], i["sha256"])),
        "files": {p.relative_to(folder).as_posix(): sha256(p) for p in sorted(folder.rglob("*")) if p.is_file()},
    }


def read(folder: Path) -> Manifest | None:
    """Manifest of a folder; None where there is none.

    Raises
    ------
    InputError
        The manifest is damaged, or of a newer version.
    """
    path = folder / NAME
    try:
        data = read_json(path, SCHEMA, CURE)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(str(path), f"it cannot be read ({error.strerror})", CURE) from error
    from identification.results.manifest_file import ManifestFile  # which takes time to load

    validate(ManifestFile, path, data, CURE)
    files, command, options = data["files"], data["command"], data.get("options", {})
    _check_names(path, files, data["holds"])
    inputs: dict[str, list[str]] = {}
    for entry in data["inputs"]:
        inputs.setdefault(entry["name"], []).append(entry["sha256"])
    words, arguments = made_by(command, options), data.get("arguments")
    return Manifest(command, data["holds"], files, inputs, words, arguments, options, data.get("version", ""))


def _check_names(path: Path, files: Mapping[str, str], holds: str) -> None:
    """Check that a manifest lists all that it has to, and nothing outside of its folder; InputError if not."""
    for name in files:
        if Path(name).anchor or ".." in Path(name).parts:
            raise InputError(str(path), f"it lists {name!r}, which is not in the folder", CURE)
    if absent := [name for name in ALWAYS.get(holds, ()) if name not in files]:
        raise InputError(str(path), f"it does not list {', '.join(absent)}", CURE)


def lists(path: Path) -> bool:
    """Whether the manifest beside a file lists it, so that a command wrote it; a foreign manifest lists nothing."""
    try:
        beside = read(path.parent)
    except InputError:
        return False
    return beside is not None and path.name in beside.files


def wrong(folder: Path) -> list[str]:
    """Files of `folder` that differ from its manifest; missing files are not among them."""
    manifest = read(folder)
    files = {} if manifest is None else manifest.files
    return [n for n, digest in files.items() if (folder / n).is_file() and sha256(folder / n) != digest]


def _unlisted(folder: Path, manifest: Manifest) -> list[str]:
    """Files beside a fit that are read with it, and that its manifest does not list."""
    read_too = SOMETIMES if manifest.holds == "model" else ()
    return [name for name in read_too if name not in manifest.files and (folder / name).is_file()]


def missing(folder: Path) -> tuple[str, ...]:
    """A note on a folder of results without a manifest: nothing shows whether its files were changed."""
    if read(folder) is not None:
        return ()
    return (
        f"{folder.name} holds no {NAME}: whether its files belong together, or were changed since, cannot be checked. "
        "Run the fit again if it is not known where they come from",
    )


def check_whole(folder: Path) -> None:
    """Check that the files of a folder of results belong together, before any is read.

    Folders written before manifests existed are accepted without one, and folders without their pages, which are large.

    Raises
    ------
    InputError
        A file was changed, is of another result, or is missing.
    """
    manifest = read(folder)
    if manifest is None:
        return
    if others := [*wrong(folder), *_unlisted(folder, manifest)]:
        raise foreign(folder, others[0], manifest)
    if gone := [name for name in _gone(folder, manifest) if not name.endswith(FOR_PEOPLE)]:
        found = f"it is missing; {_maker(manifest)} wrote it to this folder"
        raise InputError(str(folder / gone[0]), found, PUT_BACK)


def _gone(folder: Path, manifest: Manifest) -> list[str]:
    """Files that a manifest lists and that are not there."""
    return [name for name in manifest.files if not (folder / name).is_file()]


def check_complete(folder: Path, manifest: Manifest) -> None:
    """Check that all files of a folder are there and as they were written.

    Raises
    ------
    InputError
        About all that are not.
    """
    bad = dict.fromkeys(wrong(folder), "changed, or of another result")
    bad |= dict.fromkeys(_gone(folder, manifest), "missing")
    bad |= dict.fromkeys(_unlisted(folder, manifest), f"not listed in {NAME}")
    if bad:
        found = "; ".join(f"{name}: {what}" for name, what in bad.items())
        raise InputError(str(folder), found, PUT_BACK)


def inside(folder: Path, manifest: Manifest) -> Iterator[tuple[Path, Manifest]]:
    """Other results in a folder of results, such as tables and the parts of a fleet, with their manifests."""
    for path in sorted(folder.rglob(NAME)):
        place = path.parent.relative_to(folder)
        ours = path.parent == folder or path.relative_to(folder).as_posix() in manifest.files
        if not ours and not any(name.startswith(".") for name in place.parts):  # of a run that is at work
            other = read(path.parent)
            if other is not None:
                yield path.parent, other


def foreign(folder: Path, name: str, manifest: Manifest) -> InputError:
    """Error for a file that is not the one listed in the manifest."""
    by = _maker(manifest)
    found = f"it is not the file that {by} wrote to this folder: it was changed since, or is of another result"
    cure = PUT_BACK
    if name == "machine.yaml":
        cure = f"Fit a machine that was edited to a folder of its own (errormodel fit {folder / name} SURVEY --out NEW)"
        cure += ", or put the file back"
    return InputError(str(folder / name), found, cure)


def _maker(manifest: Manifest) -> str:
    return f"`errormodel {manifest.command}`" if manifest.command else "errormodel"
