"""The registry of the rules that decide in a diagnosis, and the code that writes the decision log, agree."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

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
