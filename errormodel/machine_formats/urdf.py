"""The Unified Robot Description Format of ROS: a tree of links and joints in XML."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar
from xml.sax.saxutils import quoteattr

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import TOOL
from errormodel.exceptions import InputError, nearest
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_formats.base import Description, Extras, MachineFormat, Part, Template, Written, identifiers
from errormodel.machine_formats.transforms import (
    MM_PER_M,
    Links,
    inverse,
    links_of,
    rpy_angles,
    rpy_matrix,
    shape_of,
    transform,
)
from errormodel.machine_formats.urdf_origins import numbers, origin_attributes, with_origins
from errormodel.machine_formats.xml_text import Element, parse_xml
from errormodel.raw_formats.base import RawFile

TYPES = {"revolute": "rotary", "continuous": "rotary", "prismatic": "prismatic"}
AXIS_TOLERANCE = 0.01  # of the length of an axis, beyond which its digits are no rounding; by judgement
MOST_JOINTS = 150  # that move in one chain, as in a machine file
LARGEST_ANGLE = 4 * math.pi  # rad, of an origin or a limit: degrees, most likely, beyond
LONGEST_MEMBER_M = 20.0  # of a robot's member; by judgement: longer is in mm
ORIGIN_KEYS = ("xyz", "rpy")
SAME_AXIS, SAME_PLACE = 1e-9, 1e-6  # of the same machine, through its file: rounding
ROUNDED_AXIS = 1e-6  # of the length of an axis: a difference that is worth a note


class Urdf(MachineFormat):
    """Joints that turn (``revolute``, ``continuous``), slide (``prismatic``) or are ``fixed``, in m and rad.

    All links between two joints that move become one member, with the name of the first of them. Joints keep their
    names, and limits become travels. A tree is read from ``--base`` to ``--tip``; macros of xacro are not expanded.
    """

    name: ClassVar = "urdf"
    title: ClassVar = "a URDF"
    source: ClassVar = "the URDF's XML specification, http://wiki.ros.org/urdf/XML/joint (origin, axis, limit)"

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        return raw.text is not None and re.search(r"<robot[\s>]", raw.text) is not None

    @classmethod
    def read(cls, raw: RawFile, part: Part) -> Description:
        robot = parse_xml(raw)
        _check_expanded(raw, robot)
        if robot.tag != "robot":
            raise InputError(f"{raw.name}, line {robot.line}", f"<{robot.tag}>", "Give a URDF, which begins <robot>")
        path, base = _path(raw.name, robot, part)
        moving = [_attribute(raw.name, j, "name") for j in path if j.attributes.get("type") != "fixed"]
        if not moving:
            raise InputError(raw.name, f"no joint that moves from '{base}' on", "Give another --base and --tip")
        twice = next((n for k, n in enumerate(moving) if n in moving[:k]), None)
        if twice is not None:
            raise InputError(raw.name, f"two joints of the chain are called '{twice}'", "Give each a name of its own")
        names = identifiers(moving)
        links = _members(raw.name, path, base)
        members = identifiers(links, [*names.values(), TOOL])
        notes = [f"'{a}' is called {b} here" for a, b in {**names, **members}.items() if a != b]
        elements: list[Shape | Joint] = []
        fixed, member = np.eye(4), 0
        for joint in path:
            fixed = fixed @ _origin(raw.name, joint)
            if joint.attributes["type"] == "fixed":
                continue
            _check_size(links[member], fixed, notes)
            if elements or not np.array_equal(fixed, np.eye(4)):  # before the first joint a member may be missing
                elements.append(shape_of(members[links[member]], fixed))
            elements.append(_joint(raw.name, joint, names, notes))
            fixed, member = np.eye(4), member + 1
        _check_size(links[member], fixed, notes)
        elements.append(shape_of(members[links[member]], fixed))
        return Description(robot.attributes.get("name", "") or "robot", tuple(elements), tuple(notes))

    @classmethod
    def write(cls, machine: Machine, suffix: str, extras: Extras) -> Written:
        links = links_of(machine)
        names = _link_names(machine)
        lines = ['<?xml version="1.0"?>', f"<!-- {extras.heading.replace('--', '- -')} -->"] if extras.heading else []
        lines = lines or ['<?xml version="1.0"?>']
        lines.append(f"<robot name={quoteattr(machine.name)}>")
        lines += [f"  <link name={quoteattr(name)}/>" for name in names]
        for k, (joint, fixed) in enumerate(zip(links.joints, links.fixed[:-1], strict=True)):
            low, high = (v / MM_PER_M if joint.type == "prismatic" else v for v in joint.travel)
            kind = "prismatic" if joint.type == "prismatic" else "revolute"
            lines += [
                *_head(joint.name, kind, names[k], names[k + 1]),
                f"    <origin {origin_attributes(fixed)}/>",
                f'    <axis xyz="{numbers(joint.axis)}"/>',
                f'    <limit lower="{low!r}" upper="{high!r}" effort="0" velocity="0"/>',
                "  </joint>",
            ]
        lines += [
            *_head(f"{names[-2]}_joint", "fixed", names[-3], names[-2]),
            f"    <origin {origin_attributes(links.fixed[-1])}/>",
        ]
        lines += ["  </joint>", *_head(f"{names[-1]}_joint", "fixed", names[-2], names[-1])]
        lines += [f"    <origin {origin_attributes(transform(machine.tool))}/>", "  </joint>", "</robot>", ""]
        notes = (
            f"the functional point of machine.yaml is the link {names[-1]}, the last frame {names[-2]}",
            "effort and velocity of the limits are 0, since nothing is known of them",
        )
        return Written("\n".join(lines), notes, transform([-v for v in machine.tool]))

    @classmethod
    def rewrite(cls, machine: Machine, template: Template) -> Written:
        raw, links, before = template.raw, links_of(machine), links_of(template.nominal)
        own = links_of(Machine("template", cls.read(raw, template.part).elements))
        _check_same(raw.name, own, before)
        path, _ = _path(raw.name, parse_xml(raw), template.part)
        moving = [k for k, joint in enumerate(path) if joint.attributes["type"] != "fixed"]
        origins, start = [], 0
        for k, fixed in zip(moving, links.fixed[:-1], strict=True):
            between = _product(raw.name, path[start:k])
            origins.append((path[k], inverse(between) @ fixed))
            start = k + 1
        if start < len(path):
            origins.append((path[start], links.fixed[-1] @ inverse(_product(raw.name, path[start + 1 :]))))
            return Written(with_origins(raw.text or "", origins))
        last, end = path[moving[-1]].attributes["name"], links.fixed[-1]
        notes: tuple[str, ...] = ()
        if not np.array_equal(end, np.eye(4)):
            place, turned = (", ".join(f"{v:.7g}" for v in three) for three in (end[:3, 3] / MM_PER_M, rpy_angles(end)))
            notes = (f"behind '{last}' hangs no fixed joint: xyz {place}, rpy {turned} (m, rad) is not in the file",)
        return Written(with_origins(raw.text or "", origins), notes, end)


def _product(name: str, joints: Sequence[Element]) -> Array:
    """The origins of joints, one after the other."""
    out = np.eye(4)
    for joint in joints:
        out = out @ _origin(name, joint)
    return out


def _check_same(name: str, own: Links, machine: Links) -> None:
    """Raise InputError where a machine was not made of this file: its joints would mean others."""
    cure = "Give the URDF that `errormodel machine` made the machine of, with the same --base and --tip"
    kinds = [[j.type for j in links.joints] for links in (own, machine)]
    if kinds[0] != kinds[1]:
        found = f"a chain of {', '.join(kinds[0])} joints, where the machine has {', '.join(kinds[1])}"
        raise InputError(f"--into {name}", found, cure)
    for joint, other in zip(own.joints, machine.joints, strict=True):
        if not np.allclose(joint.axis, other.axis, rtol=0, atol=SAME_AXIS):
            raise InputError(f"--into {name}", f"another axis of {joint.name} than that of {other.name}", cure)
    for k, (one, two) in enumerate(zip(own.fixed, machine.fixed, strict=True)):
        if np.abs(one - two).max() > SAME_PLACE:
            place = f"behind {own.joints[k - 1].name}" if k else "before the first joint"
            found = f"what lies {place} is not what the nominal machine has there, by {np.abs(one - two).max():.3g}"
            raise InputError(f"--into {name}", found, cure)


def _check_expanded(raw: RawFile, robot: Element) -> None:
    """Raise InputError where a file has macros."""
    for element in robot.walk():
        macro = element.tag.startswith("xacro:") or any(re.search(r"\$[({]", v) for v in element.attributes.values())
        if macro:
            where = f"{raw.name}, line {element.line}"
            found = f"<{element.tag}> has a macro or an expression of xacro, which is not expanded here"
            raise InputError(where, found, "Run `xacro FILE > robot.urdf`, and give robot.urdf")


def _attribute(name: str, element: Element, key: str) -> str:
    if not element.attributes.get(key):
        raise InputError(f"{name}, line {element.line}", f"<{element.tag}> without {key}", f'Write {key}="..."')
    return element.attributes[key]


def _link(name: str, joint: Element, key: str) -> str:
    end = joint.first(key)
    if end is None:
        where = f"{name}, line {joint.line}, joint {joint.attributes.get('name', '')}"
        raise InputError(where, f"no <{key}>", f'Write <{key} link="..."/>')
    return _attribute(name, end, "link")


def _path(name: str, robot: Element, part: Part) -> tuple[list[Element], str]:
    """Joints from the base to the tip, and the base's name."""
    joints = list(robot.all("joint"))
    if not joints:
        raise InputError(name, "no <joint>", "Give the description of a robot")
    above: dict[str, Element] = {}  # the joint that carries a link
    links: dict[str, None] = dict.fromkeys(_attribute(name, link, "name") for link in robot.all("link"))
    for joint in joints:
        kind, child, parent = _attribute(name, joint, "type"), _link(name, joint, "child"), _link(name, joint, "parent")
        if kind not in (*TYPES, "fixed", "floating", "planar"):
            where = f"{name}, line {joint.line}, joint {joint.attributes.get('name', '')}"
            raise InputError(where, f"a joint of type '{kind}'", nearest(kind, (*TYPES, "fixed")))
        if child in above:
            found = f"the link '{child}' hangs on two joints, which closes a loop"
            raise InputError(f"{name}, line {joint.line}", found, "Give a tree: serial chains are modelled")
        above[child] = joint
        links[parent] = links[child] = None
    parents = {_link(name, joint, "parent") for joint in joints}
    for key, link in (("--base", part.base), ("--tip", part.tip)):
        if link and link not in links:
            raise InputError(f"{key}", f"{name} has no link '{link}'", nearest(link, links))
    base = part.base or _root(name, links, above)
    below = [] if part.tip else [link for link in _below(base, above) if link not in parents]
    tip = part.tip or (below[0] if len(below) == 1 else "")
    if not tip:
        found = f"{len(below)} ends: {', '.join(below[:12])}" if below else f"nothing hangs on the link '{base}'"
        raise InputError(name, found, "Say with --tip which link is the end of the chain, and with --base its begin")
    way = _ancestors(name, tip, above)
    if base not in way or base == tip:
        found = (
            f"the link '{base}' is not on the way from '{tip}' to the root ({', '.join(way[1:]) or 'the root itself'})"
        )
        raise InputError("--base", found, "Give a link of that way")
    path = [above[link] for link in reversed(way[: way.index(base)])]
    if sum(joint.attributes["type"] != "fixed" for joint in path) > MOST_JOINTS:
        raise InputError(name, f"more than {MOST_JOINTS} joints that move from '{base}' to '{tip}'", "Give one robot")
    _check_path(name, path)
    return path, base


def _root(name: str, links: Mapping[str, None], above: Mapping[str, Element]) -> str:
    roots = [link for link in links if link not in above]
    hung = {joint.first("parent").attributes["link"] for joint in above.values()}  # type: ignore[union-attr]
    roots = [link for link in roots if link in hung]
    if len(roots) != 1:
        found = f"{len(roots)} links that no joint carries: {', '.join(roots[:12])}" if roots else "joints in a loop"
        raise InputError(name, found, "Say with --base which is the first, and with --tip the last")
    return roots[0]


def _below(base: str, above: Mapping[str, Element]) -> list[str]:
    """The links that a link carries, in the order of the file."""
    carried: dict[str, list[str]] = {}
    for child, joint in above.items():
        carried.setdefault(joint.first("parent").attributes["link"], []).append(child)  # type: ignore[union-attr]
    found, stack = set[str](), [base]
    while stack:
        for child in carried.get(stack.pop(), []):
            if child not in found:  # a loop, which the way from its tip is refused for
                found.add(child)
                stack.append(child)
    return [link for link in above if link in found]


def _ancestors(name: str, link: str, above: Mapping[str, Element]) -> list[str]:
    """The link, and those that carry it up to the root."""
    way, seen = [link], {link}
    while way[-1] in above:
        way.append(_link(name, above[way[-1]], "parent"))
        if way[-1] in seen:
            raise InputError(name, f"the link '{way[-1]}' carries itself", "Give a tree: serial chains are modelled")
        seen.add(way[-1])
    return way


def _check_path(name: str, path: Sequence[Element]) -> None:
    """Raise InputError for joints of the chain that a serial chain of commanded joints has not."""
    for joint in path:
        own, kind = _attribute(name, joint, "name"), joint.attributes["type"]
        where = f"{name}, line {joint.line}, joint {own}"
        for tag in ("origin", "axis", "limit", "parent", "child"):
            if len([*joint.all(tag)]) > 1:
                raise InputError(where, f"<{tag}> more than once", "Write it once")
        origin = joint.first("origin")
        other = [key for key in (origin.attributes if origin is not None else ()) if key not in ORIGIN_KEYS]
        if other:
            found = f'{other[0]}="{origin.attributes[other[0]][:60]}", which an origin of a URDF has not'  # type: ignore[union-attr]
            raise InputError(f"{where}, origin", found, 'Write xyz="..." in m and rpy="..." in rad')
        if kind in ("floating", "planar"):
            found = f"a {kind} joint, which moves in more than one way"
            raise InputError(where, found, "Give a --base behind it, or describe it as single joints")
        if (mimic := joint.first("mimic")) is not None:
            leader = mimic.attributes.get("joint", "")
            found = f"it mimics '{leader}', and a chain whose joints are coupled is not modelled"
            raise InputError(where, found, "Give a --base and a --tip between which every joint is commanded")


def _check_size(link: str, fixed: Array, notes: list[str]) -> None:
    """Add a note on a member that is longer than a robot's is."""
    length = float(np.linalg.norm(fixed[:3, 3])) / MM_PER_M
    if length > LONGEST_MEMBER_M:
        notes.append(f"the member {link} is {length:.4g} m long: in a URDF xyz is in m, not mm")


def _members(name: str, path: Sequence[Element], base: str) -> list[str]:
    """For each stretch between joints that move the name of its first link."""
    out = [base]
    return out + [_link(name, joint, "child") for joint in path if joint.attributes["type"] != "fixed"]


def _origin(name: str, joint: Element) -> Array:
    origin = joint.first("origin")
    if origin is None:
        return np.eye(4)
    where = f"{name}, line {origin.line}, joint {joint.attributes.get('name', '')}, origin"
    offset = MM_PER_M * np.array(_three(where, origin, "xyz", "0 0 0"))
    angles = _three(where, origin, "rpy", "0 0 0")
    if max(map(abs, angles)) > LARGEST_ANGLE:
        raise InputError(where, f'rpy="{origin.attributes["rpy"][:60]}", more than two turns', "Write rpy in rad")
    return transform(offset, rpy_matrix(angles))


def _three(where: str, element: Element, key: str, default: str) -> tuple[float, ...]:
    text = element.attributes.get(key, default)
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        values = ()
    if len(values) != 3 or not all(math.isfinite(v) and abs(v) < 1e9 for v in values):
        raise InputError(where, f'{key}="{text[:60]}"', f'Write three numbers, such as {key}="0 0 0.5"')
    return values


def _joint(name: str, joint: Element, names: Mapping[str, str], notes: list[str]) -> Joint:
    own, kind = joint.attributes["name"], joint.attributes["type"]
    where = f"{name}, line {joint.line}, joint {own}"
    axis = joint.first("axis")
    vector = np.array((1.0, 0.0, 0.0) if axis is None else _three(where, axis, "xyz", "1 0 0"))
    size = float(np.linalg.norm(vector))
    if abs(size - 1) > AXIS_TOLERANCE:
        unit = f', here xyz="{" ".join(f"{v:.12g}" for v in vector / size + 0.0)}"' if size else ""
        raise InputError(where, f"an axis of length {size:.6g}", f"Write a vector of length 1{unit}")
    if abs(size - 1) > ROUNDED_AXIS:
        notes.append(f"the axis of {own} has length {size:.6g}: made 1")
    x, y, z = (float(v) + 0.0 for v in vector / size)
    scale = MM_PER_M if kind == "prismatic" else 1.0
    found = Joint(names[own], "prismatic" if kind == "prismatic" else "rotary", (x, y, z), (-math.pi, math.pi))
    if kind == "continuous":
        notes.append(f"{own} turns without end: its travel is taken as -180 to 180 degrees")
        return found
    limit = joint.first("limit")
    if limit is None or not {"lower", "upper"} & {*limit.attributes}:
        raise InputError(where, f"a {kind} joint without limits", 'Write <limit lower="..." upper="..."/>')
    low, high = (_limit(where, limit, key) * scale for key in ("lower", "upper"))
    if not low < high:
        raise InputError(where, f"limits from {low / scale:g} to {high / scale:g}", "Write lower below upper")
    if kind == "revolute" and max(-low, high) > LARGEST_ANGLE:
        turns = max(-low, high) / (2 * math.pi)
        notes.append(
            f"{own} turns up to {turns:.3g} times around by its limits: in a URDF they are in rad, not degrees"
        )
    return replace(found, travel=(low, high))


def _limit(where: str, limit: Element, key: str) -> float:
    text = limit.attributes.get(key, "0")  # the specification's default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or abs(value) > 1e9:
        raise InputError(where, f'{key}="{text[:40]}"', f'Write a number, such as {key}="3.14"')
    return value


def _link_names(machine: Machine) -> list[str]:
    """Names of the links: of the member behind each joint, or of the joint; then the flange and the tool."""
    joints = [j.name for j in machine.joints]
    wanted: list[str] = [next((e.name for e in machine.elements[:1] if isinstance(e, Shape)), "base_link")]
    for element, follows in zip(machine.elements, (*machine.elements[1:], None), strict=True):
        if isinstance(element, Joint):
            wanted.append(follows.name if isinstance(follows, Shape) else f"{element.name}_link")
    used: set[str] = set()
    out = []
    for name in (*wanted, "flange", "tool_point"):
        plain = name
        while plain in used or plain in joints:
            plain += "_link"
        used.add(plain)
        out.append(plain)
    return out


def _head(name: str, kind: str, parent: str, child: str) -> list[str]:
    return [
        f"  <joint name={quoteattr(name)} type={quoteattr(kind)}>",
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
    ]
