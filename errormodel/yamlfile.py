"""Safe reading of YAML files with line numbers, and validation by pydantic models.

Nothing in a file is executed: only text, numbers, booleans, lists and mappings are built. Every fault becomes one
:class:`~errormodel.exceptions.InputError` with file, line and key.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML, MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.error import MarkedYAMLError, ReusedAnchorWarning, YAMLError

from errormodel.exceptions import InputError, nearest
from errormodel.inputs import is_unicode, noted

Keys: TypeAlias = tuple[str | int, ...]
"""The way to a value: keys of mappings, and places in lists counted from 0."""

MAX_YAML_BYTES = 300_000  # longest file, bytes: at most 5 s to parse; the longest of a machine has some 20 kB
MAX_YAML_VALUES = 100_000  # most values; every use of an alias counts, which stops files that expand exponentially
MAX_YAML_DEPTH = 40  # deepest nesting; by judgement
MOST_KEPT_CHARACTERS = 30_000  # of a text whose nodes are kept, some 10 MB; machines and surveys are shorter

_YAML_TAG = "tag:yaml.org,2002:"  # prefix of YAML's own tags
# tags of values that are constructed, with their names in messages
_CONSTRUCTED_TAGS = {
    _YAML_TAG + "int": "a whole number",
    _YAML_TAG + "float": "a number",
    _YAML_TAG + "bool": "true or false",
    _YAML_TAG + "null": "nothing",
}
# tags of values read as text, dates among them
_TEXT_TAGS = {_YAML_TAG + name for name in ("str", "timestamp", "value", "merge")}

LARGEST_NUMBER = 1e15  # beyond all quantities of machines in any unit, and far below what squares overflow at

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
"""A finite number of a size that can be computed with; text and true/false are refused."""

Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]


class FileModel(BaseModel):
    """Base of the file schemas: no unknown keys, no conversion of text into numbers.

    A field's ``description`` is the correction in messages: the value to write, with an example.
    """

    # A schema is built where it is first used: a bare table needs none of a survey.yaml's.
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)


def _no_bool(value: object) -> object:
    return str(value).lower() if isinstance(value, bool) else value  # True == 1 would pass as version 1


class VersionedModel(FileModel):
    """A file whose first line is ``errormodel: 1``."""

    errormodel: Annotated[Literal[1], BeforeValidator(_no_bool)] = Field(
        description="1 (the version of the file format that this program reads)"
    )


@dataclass(frozen=True)
class Document:
    """A parsed file: plain dicts, lists, text and numbers, and the line of each."""

    name: str  # of the file, in messages
    data: dict[str, Any]
    lines: Mapping[Keys, int]

    def line_of(self, keys: Keys) -> int:
        """Line (from 1) of the key or list item, or of its nearest existing parent."""
        while keys not in self.lines:
            keys = keys[:-1]
        return self.lines[keys]

    def value_at(self, keys: Keys) -> Any:
        """Value at `keys`, which must exist."""
        value: Any = self.data
        for key in keys:
            value = value[key]
        return value

    def error(self, keys: Keys, found: str, cure: str) -> InputError:
        """Error about the value (or the missing key) at `keys`."""
        key = f", key {dotted(keys)}" if keys else ""
        return InputError(f"{self.name}, line {self.line_of(keys)}{key}", found, cure)


def dotted(keys: Keys) -> str:
    """``("chain", 2, "axis")`` as people write it, list items counted from 1: ``chain[3].axis``."""
    return "".join(f"[{key + 1}]" if isinstance(key, int) else f".{key}" for key in keys).removeprefix(".")


def shown(value: object) -> str:
    """Value for a message, on one line of at most 60 characters."""
    if value is None:
        return "nothing"
    text = json.dumps(value, ensure_ascii=False, default=str) if not isinstance(value, str) else f"'{value}'"
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def flow(value: object) -> str:
    """Value in YAML's flow style on one line, for examples."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {flow(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(flow, value))}]"
    return value if isinstance(value, str) and re.fullmatch(r"[A-Za-z_][\w-]*", value) else json.dumps(value)


def load(path: Path) -> Document:
    """Read a YAML file.

    Parameters
    ----------
    path : Path
        The file, UTF-8.

    Returns
    -------
    Document
        Its keys and values, with their lines.

    Raises
    ------
    InputError
        The file is missing, too long, empty, not UTF-8 or not YAML, or has tags or repeated keys.
    """
    try:
        with noted(path).open("rb") as file:
            raw = file.read(MAX_YAML_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(str(path), f"cannot be read: {reason}", "Give the path of a YAML file") from error
    if len(raw) > MAX_YAML_BYTES:
        raise InputError(
            str(path), f"longer than {MAX_YAML_BYTES} bytes", "Give a YAML file; data belong in CSV or Parquet"
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        byte = f"the byte 0x{raw[error.start]:02x}, which is not UTF-8"
        raise InputError(f"{path}, line {line}", byte, "Save the file as UTF-8") from error
    return parse(text, str(path))


def parse(text: str, name: str) -> Document:
    """Like :func:`load`, for a text with the name `name` in messages."""
    yaml = YAML(typ="safe", pure=True)
    try:
        # a directive of the file would be the state of its own reader
        root = _composed(text, yaml) if len(text) > MOST_KEPT_CHARACTERS or "%" in text else _kept(text)
    except ReusedAnchorWarning as error:
        anchor, line = re.findall(r"anchor ('.*')", str(error)), re.findall(r"\(line: (\d+)\)", str(error))
        found = f"a second anchor {anchor[0]}: aliases before and behind it would be different values"
        raise InputError(f"{name}, line {line[-1]}", found, "Give each anchor a name of its own") from error
    except YAMLError as error:
        raise _syntax_error(text, name, error) from error
    except RecursionError as error:
        raise InputError(name, "lists or mappings nested too deep", "Write the keys as documented") from error
    if root is None or (isinstance(root, ScalarNode) and not root.value):
        raise InputError(name, "an empty file", "Write the keys as documented, such as 'errormodel: 1'")
    if not isinstance(root, MappingNode):
        where = f"{name}, line {root.start_mark.line + 1}"
        raise InputError(where, f"a {_kind(root)} where keys are expected", "Write 'key: value' lines")
    lines: dict[Keys, int] = {(): 1}
    data = _Builder(name, yaml, lines).build(root, ())
    return Document(name, data, lines)


def _composed(text: str, yaml: Any) -> Node | None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReusedAnchorWarning)
        root: Node | None = yaml.compose(text)
        return root


@lru_cache(maxsize=32)
def _kept(text: str) -> Node | None:
    """The nodes of a text, which are only read: a fleet reads the file of one machine for each of its surveys."""
    return _composed(text, YAML(typ="safe", pure=True))


class _Builder:
    """Conversion of YAML nodes into plain values, with the lines of all keys."""

    def __init__(self, name: str, yaml: Any, lines: dict[Keys, int]) -> None:
        self.name, self.yaml, self.lines = name, yaml, lines
        self.count = 0

    def build(self, node: Node, keys: Keys) -> Any:
        self.count += 1
        if self.count > MAX_YAML_VALUES:
            raise InputError(self.name, f"more than {MAX_YAML_VALUES} values", "Write the values out, without aliases")
        if len(keys) > MAX_YAML_DEPTH:
            raise self._error(node, keys[:3], "lists or mappings nested too deep", "Write the keys as documented")
        tag = str(node.tag)
        if isinstance(node, MappingNode) and tag == _YAML_TAG + "map":
            return self._mapping(node, keys)
        if isinstance(node, SequenceNode) and tag == _YAML_TAG + "seq":
            for i, item in enumerate(node.value):
                self.lines[(*keys, i)] = item.start_mark.line + 1
            return [self.build(item, (*keys, i)) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode) and tag in _CONSTRUCTED_TAGS:
            try:
                return self.yaml.constructor.construct_object(node)
            except (ValueError, KeyError, OverflowError, YAMLError) as error:
                raise self._error(node, keys, shown(node.value), f"Write {_CONSTRUCTED_TAGS[tag]}") from error
        if isinstance(node, ScalarNode) and tag in _TEXT_TAGS:
            return self._text(node, keys)
        tag = tag.replace(_YAML_TAG, "!!")
        raise self._error(node, keys, f"the tag {tag}", "Remove it: only text, numbers, lists and mappings are read")

    def _mapping(self, node: MappingNode, keys: Keys) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value in node.value:
            tag = str(key_node.tag)
            if not isinstance(key_node, ScalarNode) or tag not in _TEXT_TAGS:
                what = str(key_node.value)[:60] if isinstance(key_node, ScalarNode) else f"a {_kind(key_node)}"
                raise self._error(key_node, keys, f"{what} as a key", "Write the key as text, in quotes if need be")
            key = self._text(key_node, keys)
            here, line = (*keys, key), key_node.start_mark.line + 1
            if key in result:
                first = f"the key is already given in line {self.lines[here]}"
                raise self._error(key_node, here, first, "Remove one of the two")
            self.lines[here] = line
            result[key] = self.build(value, here)
        return result

    def _text(self, node: ScalarNode, keys: Keys) -> str:
        text = str(node.value)
        if not is_unicode(text):
            cure = "Write the character itself, or none"
            raise self._error(node, keys, f"{ascii(text)[:60]}, half of a character, which no file can hold", cure)
        return text

    def _error(self, node: Node, keys: Keys, found: str, cure: str) -> InputError:
        key = f", key {dotted(keys)}" if keys else ""
        return InputError(f"{self.name}, line {node.start_mark.line + 1}{key}", found, cure)


def _kind(node: Node) -> str:
    return "mapping" if isinstance(node, MappingNode) else "list" if isinstance(node, SequenceNode) else "single value"


_INDENTATION_FOUND = "the line is indented neither as those of its own block are, nor as those of the block around it"
# plain words for the messages of the parser
_SYNTAX_WORDS = {
    "expected <block end>": _INDENTATION_FOUND,
    "could not find expected ':'": "a line without a colon where 'key: value' is expected",
    "cannot start any token": "a character that no value begins with",
}
_SYNTAX_CURES = {
    "expected <block end>": "Begin all lines of one list, and all keys of one entry, with the same number of spaces",
    "could not find expected ':'": "Write 'key: value', with a space after the colon",
    "cannot start any token": "Put the value in quotes; indent with spaces, not with tabs",
    r"\\t": "Indent with spaces, not with tabs",
    "mapping values": "Write one 'key: value' a line, with a space after each colon here and in the line above",
    "end of stream|stream end": "Close the bracket or the quotation mark that is opened here",
    "another document": "Give one document a file: remove the line '---'",
    "undefined alias": "Write the value out",
    "special characters": "Remove the control character",
    "expected ',' or": "Put commas between the entries and close the bracket that is opened here",
}


def _syntax_error(text: str, name: str, error: YAMLError) -> InputError:
    problem, mark = str(error).splitlines()[0], None
    if isinstance(error, MarkedYAMLError):
        problem, mark = str(error.problem or error.context), error.problem_mark or error.context_mark
        if re.search("stream end|end of stream|expected ',' or", problem) and error.context_mark is not None:
            mark = error.context_mark  # the place of the opening bracket is more useful than the end of the file
    position = getattr(error, "position", None)
    line = mark.line + 1 if mark is not None else text[:position].count("\n") + 1 if position else 1
    problem = problem.splitlines()[0].removeprefix("but ") if problem else "not YAML"
    cure = next((cure for pattern, cure in _SYNTAX_CURES.items() if re.search(pattern, problem)), "Write valid YAML")
    words = next((words for pattern, words in _SYNTAX_WORDS.items() if pattern in problem), problem)
    return InputError(f"{name}, line {line}", words, cure)


Model = TypeVar("Model", bound=BaseModel)


def validate(document: Document, model: type[Model], at: Keys = ()) -> Model:
    """Check a document, or the part of it at `at`, against a pydantic model.

    Parameters
    ----------
    document : Document
        From :func:`load`.
    model : type of BaseModel
        Usually a :class:`FileModel`. A field's description is the cure shown when its value is wrong.
    at : tuple of str and int
        Path of the part that the model describes.

    Raises
    ------
    InputError
        About one error: the file's version first, then unknown keys, then the first in the file.
    """
    try:
        return model.model_validate(document.value_at(at))
    except ValidationError as error:
        details = error.errors(include_url=False)

    def rank(detail: ErrorDetails) -> tuple[int, int]:
        kind, loc = detail["type"], detail["loc"]
        wrong_version = loc == ("errormodel",) and kind != "missing"
        # a misspelt key is both unknown and missing: the unknown one can be named
        first = 0 if wrong_version else 1 if kind == "extra_forbidden" else 2
        return first, document.line_of((*at, *loc))

    raise _input_error(document, model, at, min(details, key=rank))


def _input_error(document: Document, model: type[BaseModel], at: Keys, detail: ErrorDetails) -> InputError:
    kind, loc, context = detail["type"], detail["loc"], detail.get("ctx", {})
    missing = kind in ("missing", "union_tag_not_found")
    if kind.startswith("union_tag"):  # a discriminated union: the error is about its discriminator
        loc = (*loc, context["discriminator"].strip("'"))
    keys = _keys(document, at, loc, missing)
    owners, field = _owners(model, loc)
    if kind == "extra_forbidden":
        names = {name for owner in owners for name in _fields(owner)}
        return document.error(keys, f"unknown key '{keys[-1]}'", nearest(str(keys[-1]), map(str, names)))
    value = None if missing else document.value_at(keys)
    found = f"the key '{keys[-1]}' is missing" if missing else shown(value)
    expected = re.findall(r"'([^']*)'", str(context.get("expected_tags", context.get("expected", ""))))
    if expected and isinstance(value, str):
        return document.error(keys, f"unknown word {found}", nearest(value, expected))
    if field is not None and field.description and kind != "value_error":  # a validator has a message of its own
        cure = f"Write {next((key for key in reversed(keys) if isinstance(key, str)), 'it')}: {field.description}"
    else:
        cure = f"Write '{keys[-1]}: ...'" if missing else detail["msg"].removeprefix("Value error, ")
    return document.error(keys, found, cure)


def _keys(document: Document, at: Keys, loc: Keys, missing: bool) -> Keys:
    """Pydantic's `loc` as keys of the file, without pydantic's names of the branches of unions."""
    keys, value = at, document.value_at(at)
    part: Any
    for part in loc:
        if (isinstance(value, dict) and part in value) or (isinstance(value, list) and isinstance(part, int)):
            keys, value = (*keys, part), value[part]
    return (*keys, loc[-1]) if missing else keys


def _owners(model: type[BaseModel], loc: Keys) -> tuple[list[type[BaseModel]], FieldInfo | None]:
    """Models that may stand at the innermost part of `loc`, and the innermost field on the way."""
    models, field = [model], None
    for part in loc:
        found = [_fields(owner)[part] for owner in models if part in _fields(owner)]
        if found:
            field = found[0]
            models = _models(field.annotation) or models
        else:  # the word that a union is told apart by
            models = [m for m in models if any(part in get_args(f.annotation) for f in _fields(m).values())] or models
    return models, field


def _fields(model: type[BaseModel]) -> dict[str | int, FieldInfo]:
    return {info.alias or name: info for name, info in model.model_fields.items()}


def _models(annotation: Any) -> list[type[BaseModel]]:
    """All models inside lists, mappings, unions and optional types."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]
