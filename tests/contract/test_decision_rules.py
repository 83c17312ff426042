"""The registry of the rules that decide in a diagnosis, and the code that writes the decision log, agree."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from identification.diagnosis.decisions import constants
from identification.diagnosis.decisions.rules import RULES
from identification.diagnosis.decisions.stages import STAGES

ROOT = Path(__file__).resolve().parents[2]
DIAGNOSIS = ROOT / "identification/diagnosis"
FILES = [f for f in sorted(DIAGNOSIS.rglob("*.py")) if f.parent.name != "decisions"]
WRITES = {"add", "set_aside", "compared"}  # methods of the log


def calls(file: Path) -> Iterator[ast.Call]:
    """The calls of a file that write a decision."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in WRITES:
            owner = ast.unparse(node.func.value)
            if owner == "log" or owner.endswith(".log"):
                yield node


def words(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)}


def test_every_rule_in_the_code_is_in_the_registry() -> None:
    seen = [(f.name, c.args[0].value) for f in FILES for c in calls(f) if isinstance(c.args[0], ast.Constant)]
    assert len(seen) > 50
    assert [(name, rule) for name, rule in seen if rule not in RULES] == []


def test_every_rule_of_the_registry_is_in_the_code() -> None:
    used = set().union(*map(words, FILES))
    assert sorted(set(RULES) - used) == []


def test_rules_that_a_call_takes_from_elsewhere_are_few() -> None:
    """A name that is no literal in the call can be anything: only where one of several rules decides."""
    taken = {f.stem for f in FILES for c in calls(f) if not isinstance(c.args[0], ast.Constant)}
    assert taken == {"forward_selection"}


@pytest.mark.parametrize("name", RULES)
def test_a_rule_says_what_it_decides(name: str) -> None:
    rule = RULES[name]
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", name)
    assert rule.stage in STAGES
    assert re.fullmatch(r"[A-Z][^\n]*[a-z]\.", rule.decides)
    for constant in rule.constants:
        module, _, own = constant.rpartition(".")
        assert hasattr(import_module(f"identification.diagnosis.{module}"), own), constant


def test_the_stages_are_in_the_order_of_the_registry() -> None:
    assert list(dict.fromkeys(rule.stage for rule in RULES.values())) == list(STAGES)


MOST_CONSTANTS = 25  # of those that decide; limits of work, and those of fits, are beside their code


def test_each_constant_that_decides_says_why_and_is_named_by_a_rule() -> None:
    """The table of the constants: a string after each is its derivation or its calibration."""
    tree = ast.parse(Path(constants.__file__ or "").read_text(encoding="utf-8"))
    first = next(k for k, node in enumerate(tree.body) if isinstance(node, ast.Assign))
    names = set[str]()
    for one, why in zip(tree.body[first::2], tree.body[first + 1 :: 2], strict=True):
        assert isinstance(one, ast.Assign)
        assert isinstance(one.targets[0], ast.Name)
        assert isinstance(why, ast.Expr)
        assert isinstance(why.value, ast.Constant)
        assert len(str(why.value.value)) > 40
        names.add(one.targets[0].id)
    named = {c.rpartition(".")[2] for rule in RULES.values() for c in rule.constants if ".constants." in f".{c}"}
    assert names == named
    assert len(names) <= MOST_CONSTANTS
