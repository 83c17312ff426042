"""What tests look for in the project's own modules; each is parsed once, and its syntax is not kept."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple


class Source(NamedTuple):
    """Of a module.

    Attributes
    ----------
    texts : line and text, but for docstrings, and for `alike`, by which an effect names others.
    imported : modules from which it imports names.
    """

    texts: tuple[tuple[int, str], ...]
    imported: tuple[str, ...]


@cache
def source(path: Path) -> Source:
    silent: set[int] = set()
    known = (ast.Constant, ast.Expr, ast.AnnAssign, ast.ImportFrom)
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if type(node) in known]
    for node in nodes:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            silent.add(id(node.value))
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == "alike":
            silent |= {id(n) for n in ast.walk(node)}
    return Source(
        tuple(
            (n.lineno, n.value)
            for n in nodes
            if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in silent
        ),
        tuple(n.module or "" for n in nodes if isinstance(n, ast.ImportFrom)),
    )
