"""Origins of the joints of a URDF replaced in its text: all other bytes, comments and blanks stay as they are."""

from __future__ import annotations

import re
from collections.abc import Sequence

from errormodel.arrays import Array
from errormodel.machine_formats.transforms import in_metres, rpy_angles
from errormodel.machine_formats.xml_text import Element

START_TAG = re.compile(rb"<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*\s*/?>")
DECLARED = re.compile(rb"^(\s*<\?xml[^>]*encoding\s*=\s*[\"'])[^\"']*")


def origin_attributes(fixed: Array) -> str:
    """``xyz="..." rpy="..."`` of a transformation, m and rad."""
    offset = [in_metres(v) for v in fixed[:3, 3].tolist()]
    return f'xyz="{numbers(offset)}" rpy="{numbers(rpy_angles(fixed[:3, :3]))}"'


def numbers(values: Sequence[float]) -> str:
    """Numbers as an attribute has them, with all their digits."""
    return " ".join(repr(float(v) + 0.0) for v in values)


def with_origins(text: str, origins: Sequence[tuple[Element, Array]]) -> str:
    """The text with other origins (mm) of some joints; where a joint has none, one is put in."""
    data = text.encode("utf-8")
    for joint, fixed in sorted(origins, key=lambda pair: -pair[0].start):
        attributes = origin_attributes(fixed).encode()
        own = joint.first("origin")
        tag = START_TAG.match(data, (own or joint).start)
        assert tag is not None  # the parser has read it
        if own is None:
            data = data[: tag.end()] + b"<origin " + attributes + b"/>" + data[tag.end() :]
            continue
        end = b"/>" if tag[0].endswith(b"/>") else b">"
        data = data[: tag.start()] + b"<origin " + attributes + end + data[tag.end() :]
    return DECLARED.sub(rb"\1utf-8", data, count=1).decode("utf-8")
