"""machine.yaml as it is written: any machine reads back the same, any change is read or refused."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel import machine_file as schema
from errormodel import yamlfile
from errormodel.conventions import MOTIONS
from errormodel.effects import registry
from errormodel.exceptions import InputError
from errormodel.joint_models.first_order import FirstOrder
from errormodel.machine import Basis, EffectSpec, Joint, Machine, Shape
from tests.helpers.machine_files import EXAMPLE, PLAIN, read


def machines_in(folder: Path) -> list[Path]:
    found = sorted(folder.glob("*/machine.yaml"))
    assert found
    return found


def test_practice_machines(practice_data: Path):
    for file in machines_in(practice_data):
        assert schema.read_machine(file).joints


def test_real_machines(real_data: Path):
    machines = {file.parent.name: schema.read_machine(file) for file in machines_in(real_data)}
    if "printer-frame" in machines:
        assert machines["printer-frame"].shapes == (Shape("frame", motions=("dz",)),)


# Written and read again


def written_and_read(machine: Machine, folder: Path) -> Machine:
    file = folder / "out.yaml"
    schema.write_machine(machine, file)
    return schema.read_machine(file)


def rounded(machine: Machine) -> Machine:
    def numbers(values: tuple[float, ...]):
        return pytest.approx(values, rel=1e-12, abs=1e-12)

    elements = tuple(
        replace(e, offset=numbers(e.offset), rotation=numbers(e.rotation))
        if isinstance(e, Shape)
        else replace(e, axis=numbers(e.axis), travel=numbers(e.travel), models=dict(e.models))
        for e in machine.elements
    )
    return replace(machine, elements=elements, tool=numbers(machine.tool), source=None)


@pytest.mark.parametrize("text", [EXAMPLE, PLAIN])
def test_written_machine_reads_the_same(text: str, tmp_path: Path):
    machine = replace(read(text), name="a name")
    assert replace(written_and_read(machine, tmp_path), source=None) == replace(machine, source=None)


def test_writing_is_readable_and_leaves_nothing_else(tmp_path: Path):
    schema.write_machine(read(EXAMPLE), tmp_path / "out.yaml")
    lines = (tmp_path / "out.yaml").read_text().splitlines()
    assert "  - {joint: B, type: rotary, axis: y, travel: [0, 360]}" in lines
    assert "    X: first-order" in lines
    assert "tool: [0, 0, -312.035]" in lines
    assert [file.name for file in tmp_path.iterdir()] == ["out.yaml"]


def test_a_machine_that_could_not_be_read_is_not_written(tmp_path: Path):
    straightness = Joint("X", "prismatic", (1.0, 0.0, 0.0), (0.0, 1.0), {"dy": Basis("first-order")})
    with pytest.raises(InputError, match="straightness"):
        schema.write_machine(Machine("m", (straightness,)), tmp_path / "out.yaml")
    assert not list(tmp_path.iterdir())


finite = st.floats(-1e6, 1e6).map(lambda x: x + 0.0)
vectors = st.tuples(finite, finite, finite)
names = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,6}", fullmatch=True).filter(
    lambda n: (
        n not in {"tool", "instrument", "frame", *schema._RESERVED_COLUMNS}
        and not n.startswith(schema._COLUMN_PREFIXES)
    )
)
texts = st.text(st.characters(codec="utf-8"), max_size=300)


@st.composite
def joints(draw: st.DrawFn, name: str) -> Joint:
    kind = draw(st.sampled_from(["prismatic", "rotary"]))
    x, y, z = draw(vectors.filter(lambda v: math.hypot(*v) > 1e-3))
    size = math.hypot(x, y, z)
    axis = draw(st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (x / size, y / size, z / size)]))
    low, length = draw(finite), draw(st.floats(1e-3, 1e6))
    joint = Joint(name, kind, axis, (low, low + length))
    families = ["polynomial", "spline"] + ["harmonic"] * (kind == "rotary")
    models = draw(
        st.dictionaries(st.sampled_from(MOTIONS), st.builds(Basis, st.sampled_from(families), st.integers(1, 50)))
    )
    models |= dict.fromkeys(draw(st.sets(st.sampled_from(FirstOrder.motions(joint)))), Basis("first-order"))
    return replace(joint, models={m: models[m] for m in MOTIONS if m in models})


@st.composite
def machines(draw: st.DrawFn) -> Machine:
    elements = []
    for i, name in enumerate(draw(st.lists(names, min_size=1, max_size=8, unique=True))):
        if i == 0 or draw(st.booleans()):
            elements.append(draw(joints(name)))
        else:
            chosen = draw(st.sets(st.sampled_from(MOTIONS)))
            elements.append(Shape(name, draw(vectors), draw(vectors), tuple(m for m in MOTIONS if m in chosen)))
    options = st.dictionaries(
        texts.filter(lambda key: key not in {"effect", "joint", "shape", "where"}),
        st.one_of(finite, st.integers(), texts, st.booleans(), st.lists(finite, max_size=3)),
        max_size=3,
    )
    effects = draw(st.lists(st.builds(EffectSpec, st.sampled_from(sorted(registry())), options), max_size=3))
    name = draw(texts.filter(lambda text: len(text) <= schema.LONGEST_NAME))
    return Machine(name, tuple(elements), draw(vectors), tuple(effects), notes=draw(texts))


@settings(max_examples=50)
@given(machine=machines())
def test_any_machine_reads_back_the_same(machine: Machine):
    again = read(schema.machine_text(machine))
    assert replace(again, source=None) == rounded(machine)


# Whatever stands in a file, it is read or refused

WEIRD = [None, True, -1, 0, 2.5, math.nan, math.inf, 10**400, "", "all", "x", [], [1], [[]], {}, {"x": 1}, {"dx": {}}]


def places(value: object, at: tuple = ()) -> list[tuple]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at] * bool(at) + [place for key, item in inner for place in places(item, (*at, key))]


ORIGINAL = yamlfile.parse(EXAMPLE, "machine.yaml")


@given(place=st.sampled_from(places(ORIGINAL.data)), weird=st.sampled_from([*WEIRD, "remove", "rename"]))
def test_any_change_is_read_or_refused(place: tuple, weird: object):
    data = copy.deepcopy(ORIGINAL.data)
    parent = data
    for key in place[:-1]:
        parent = parent[key]
    if weird in ("remove", "rename"):
        value = parent.pop(place[-1])
        if weird == "rename" and isinstance(parent, dict):
            parent["renamed"] = value
    else:
        parent[place[-1]] = weird
    said = None
    try:
        schema.resolve(replace(ORIGINAL, data=data))
    except InputError as error:
        said = error
    assert said is None or (said.where.startswith("machine.yaml, line ") and said.found and said.cure)


@given(st.text(st.sampled_from("ab1 :-[]{},&*!|>'\"#\n\t%?@~<=é"), max_size=60))
def test_any_text_is_read_or_refused(text: str):
    with pytest.raises(InputError, match=r"machine\.yaml"):
        read(text)
