"""Classification of the files in a folder of results: its own, those of other commands, and foreign ones."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from errormodel.exceptions import ErrorModelError, InputError
from errormodel.files import LOCK_FILE, sha256
from errormodel.inputs import current, running
from identification.results import manifest
from identification.results.manifest import Manifest
from identification.results.output_file import RECORD_NAME, recorded

HISTORY_FILE = "monitor.sqlite"  # database of `monitor`
HISTORY_NAME = re.compile(r"monitor\.sqlite(-journal|-wal|-shm)?")  # the database and its temporary files
CHAIN = "chain"  # an unfinished chain of `fit --bayes`
PARTS = "parts"  # finished parts of a `fleet`, each a folder of results
FAILURES = "failures.csv"  # beside them while a `fleet` is at work, and after a stop: surveys that failed until then
FAILURE_COLUMNS = ("row", "id", "survey", "wrong_input", "message")
CHAIN_PIECE = re.compile(r"\.?piece_[0-9a-f]+_\d+(\.\d+\.part)?\.npz")
UNFINISHED_NAME = re.compile(r"\..+\.(\w+\.part(\.\w+)?|old)")  # of a run that is at work, or was killed
SERVICE_FILES = (
    RECORD_NAME,
    LOCK_FILE,
    ".DS_Store",
    "Thumbs.db",
    "desktop.ini",
)  # errormodel's, and what file managers leave
FILES_WITHOUT_MANIFEST = (  # there were manifests
    "machine.yaml", "parameters.csv", "residuals.csv", "covariance.csv", "fit.json", "report.html", "posterior.nc",
    "diagnosis.json", "thermal.json", "thermal_drift.png",
)  # fmt: skip
MONITOR_FILES = ("monitor.json", "monitor.html")  # output of `monitor`
CURE = "Choose another folder, or move that file away"


def kept_of(folder: Path, own: Manifest | None) -> list[str]:
    """Files and folders of a folder of results that stay when the results are replaced.

    Raises
    ------
    InputError
        The folder holds a file that errormodel did not write, or that was changed since.
    """
    entries = sorted(folder.iterdir())
    old = FILES_WITHOUT_MANIFEST if own is None and any(e.name in FILES_WITHOUT_MANIFEST for e in entries) else ()
    if old:
        _check_before(folder)
    written = recorded(folder)
    kept = []
    for entry in entries:
        name = entry.name
        if name == manifest.NAME or name in old:
            continue
        if own is not None and _is_own(folder, entry, own):
            continue
        if not _is_known(entry, written, old):
            raise _not_ours(entry)
        kept.append(name)
    return kept


def unlisted(folder: Path, own: Manifest) -> Iterator[str]:
    """Names of the files and folders in a folder of results of which neither its manifest nor another command knows."""
    written = recorded(folder)
    for entry in sorted(folder.iterdir()):
        listed = any(name.split("/")[0] == entry.name for name in (*own.files, manifest.NAME))
        if not listed and not _is_known(entry, written, ()):
            yield entry.name
        if listed and entry.is_dir():
            paths = (p.relative_to(folder).as_posix() for p in sorted(entry.rglob("*")) if p.is_file())
            yield from (name for name in paths if name not in own.files)


def outdated(folder: Path, kept: list[str], new: Mapping[str, str]) -> Iterator[str]:
    """Sentences on what the `new` files (digests) replace, and on what stays and was made from earlier results."""
    own = manifest.read(folder)
    run = current()
    if own is not None and run is not None and own.made_by != manifest.made_by(run.command, run.options):
        gone = [name for name in own.files if name not in new and "/" not in name]
        more = f" and {len(gone) - 3} more" if len(gone) > 3 else ""
        left = f": {', '.join(gone[:3])}{more} {'are' if len(gone) > 1 else 'is'} gone" if gone else ""
        yield f"replaced {own.made_by} in {folder}{left}"
    if own is not None and own.files.get("machine.yaml") != new.get("machine.yaml") and HISTORY_FILE in kept:
        yield f"{folder / HISTORY_FILE} stays, and was learned with the model that was here before"
    for name in kept:
        made = manifest.read(folder / name) if (folder / name).is_dir() else None
        if made is not None and "fit.json" in made.inputs and new.get("fit.json") not in made.inputs["fit.json"]:
            yield f"{folder / name} stays, and was made from the fit that was here before: run {made.command} again"


def _is_own(folder: Path, entry: Path, own: Manifest) -> bool:
    """Whether a file agrees with the manifest, or all files of a folder do.

    Raises
    ------
    InputError
        Only some files of a folder agree, or the file was changed.
    """
    name = entry.relative_to(folder).as_posix()
    if entry.is_symlink():
        return False
    if entry.is_dir():
        if not any(listed.startswith(f"{name}/") for listed in own.files):
            return False
        for part in entry.iterdir():
            if not _is_own(folder, part, own):
                raise _not_ours(part)
        return True
    if name in own.files and sha256(entry) != own.files[name]:
        raise InputError(str(entry), "it was changed since errormodel wrote it", CURE)
    return name in own.files


def _is_known(entry: Path, written: Mapping[str, set[str]], old: tuple[str, ...]) -> bool:
    """Whether another command wrote a file or folder, or it serves one, or a file manager."""
    name = entry.name
    if not entry.is_file() or entry.is_symlink():
        return _is_anothers(entry)
    servant = name in SERVICE_FILES or HISTORY_NAME.fullmatch(name) or (old and name in MONITOR_FILES)
    return bool(servant or UNFINISHED_NAME.fullmatch(name) or (name in written and sha256(entry) in written[name]))


def _is_anothers(entry: Path) -> bool:
    """Whether a folder is another result, an unfinished chain, or belongs to a running command."""
    if entry.is_symlink() or not entry.is_dir():
        return False
    if entry.name == CHAIN and all(CHAIN_PIECE.fullmatch(p.name) for p in entry.iterdir()):
        return True
    if entry.name == PARTS and all(map(_is_part_or_service, (p for own in entry.iterdir() for p in _inside(own)))):
        return True
    tables = (entry / "compensation.json").is_file()  # of a version without manifests
    return tables or bool(UNFINISHED_NAME.fullmatch(entry.name)) or manifest.read(entry) is not None


def _inside(folder: Path) -> list[Path]:
    """Entries of a folder; of a file the file itself."""
    return [*folder.iterdir()] if folder.is_dir() and not folder.is_symlink() else [folder]


def _is_part_or_service(entry: Path) -> bool:
    unfinished = entry.name in SERVICE_FILES or bool(UNFINISHED_NAME.fullmatch(entry.name))
    return unfinished or (not entry.is_symlink() and (manifest.read(entry) is not None or _are_failures(entry)))


def _are_failures(entry: Path) -> bool:
    if entry.name != FAILURES or not entry.is_file():
        return False
    header = ",".join(FAILURE_COLUMNS).encode() + b"\n"
    with entry.open("rb") as file:
        return file.read(len(header)) == header[: entry.stat().st_size]


def _check_before(folder: Path) -> None:
    """Check that a folder without a manifest holds an unedited fit of a version that wrote none.

    Raises
    ------
    InputError
        The files are no such fit, or were edited, or this cannot be determined.
    """
    from errormodel.machine_file import machine_text, read_machine
    from identification.results.stored_fit import read_files

    path = folder / "machine.yaml"
    try:
        with running(None):  # this is no input, and the folder may be locked already
            read_files(folder)
            plain = path.read_text(encoding="utf-8") == machine_text(read_machine(path))
    except (ErrorModelError, OSError, ValueError) as error:
        name = next(n for n in FILES_WITHOUT_MANIFEST if (folder / n).exists())
        raise _not_ours(folder / name) from error
    if not plain:
        raise InputError(str(path), "it was edited since errormodel wrote it", CURE)


def _not_ours(path: Path) -> InputError:
    return InputError(str(path), "errormodel did not write it, and would remove it with the old results", CURE)
