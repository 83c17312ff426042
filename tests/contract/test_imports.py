"""Who imports whom: no circle, and the command line and the notebooks stand on the public functions."""

from __future__ import annotations

import ast
import importlib
import importlib.util
from collections.abc import Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import pytest

import errormodel
import identification

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("errormodel", "identification")
BODY = " (body)"  # what runs when a module of a package is imported: the package's own module-level code

# What the command line may import, by module or by names of one, and why.
OF_COMMAND_LINE = {
    "identification.api": "the public functions",
    "identification.command_line": "its own modules",
    "identification.results": "what the public functions return, and files and folders that are written",
    "errormodel.exceptions": "errors, and the nearest of several names",
    "errormodel.inputs": "what a command reads and writes is noted for its manifest",
}

# What a notebook may import beyond the public names, and why.
OF_NOTEBOOKS = {
    "04_paper_profiler_gantry": {
        "identification.registration": "the paper's equations are checked one by one: each is a step of `register`",
        "identification.plots.style": "its figures put many small panels at places in inches",
    },
    "06_paper_cmm_thermal": {
        "errormodel.chain": "the paper's equations are compared with exact derivatives, to 1e-9",
        "errormodel.arrays": "rows for these",
        "identification.uncertainty.budget": "the paper's own budget, line by line, of no fit",
    },
}


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def statements(tree: ast.AST, functions: bool = True) -> Iterator[ast.AST]:
    """All nodes of a module but those for type checkers; without `functions` those that run when it is imported."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.expr) or is_type_checking(node):  # no expression holds a statement
            continue
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not functions:
            continue
        yield node
        yield from statements(node, functions)


def imported(tree: ast.AST, functions: bool = True) -> Iterator[tuple[str, str]]:
    """Module and name (empty for a module as such) of each import, wherever in the module it stands."""
    for node in statements(tree, functions):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module, "relative imports are not followed"
            assert not node.level, "relative imports are not followed"
            yield from ((node.module, alias.name) for alias in node.names)


class Imports(NamedTuple):
    """Of a module: module and name of each, in functions too, and of those that run when it is imported."""

    anywhere: set[tuple[str, str]]
    at_once: set[tuple[str, str]]


def modules(root: Path, packages: tuple[str, ...]) -> dict[str, Imports]:
    """Every module of the packages by its name; its syntax is not kept."""
    found = {}
    for file in sorted(f for package in packages for f in (root / package).rglob("*.py")):
        parts = file.relative_to(root).with_suffix("").parts
        tree = ast.parse(file.read_text(encoding="utf-8"))
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = Imports({*imported(tree)}, {*imported(tree, functions=False)})
    return found


def graph(imports: Mapping[str, Imports]) -> dict[str, set[str]]:
    """For each module those that it needs; a package counts as a whole only where its own names are imported."""
    packages = {above for name in imports for above in accumulate(name.split(".")[:-1], "{}.{}".format)} & {*imports}

    def needed(name: str, given: set[tuple[str, str]]) -> set[str]:
        out = set()
        for module, word in given:
            target = f"{module}.{word}" if f"{module}.{word}" in imports else module
            if target not in imports:
                continue
            out.add(target)
            above = target.split(".")
            for k in range(1, len(above)):
                package = ".".join(above[:k])
                if not f"{name}.".startswith(f"{package}."):  # its own packages are imported already
                    out.add(package + BODY)
        return out - {name}

    edges = {name: needed(name, own.anywhere) for name, own in imports.items()}
    return edges | {name + BODY: needed(name, imports[name].at_once) for name in packages}


def circle(edges: Mapping[str, set[str]]) -> list[str]:
    """Modules of one circle in their order, if there is one."""
    done: set[str] = set()

    def walk(name: str, path: list[str]) -> list[str]:
        if name in path:
            return [*path[path.index(name) :], name]
        if name in done:
            return []
        for other in sorted(edges[name]):
            if found := walk(other, [*path, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(edges) if (found := walk(name, []))), [])


def test_no_module_imports_itself_through_others() -> None:
    """In functions neither: a circle that is put off until a call is one all the same."""
    found = circle(graph(modules(ROOT, PACKAGES)))
    assert not found, " -> ".join(found)


@pytest.mark.parametrize(
    ("one", "other", "names"),
    [
        ("from p import b\n", "from p.a import x\n", "p.a -> p.b -> p.a"),
        ("from p import b\n", "def f():\n    import p.a\n", "p.a -> p.b -> p.a"),
        ("from p import b\n", "if TYPE_CHECKING:\n    import p.a\n", ""),
        ("import q.c\n", "", "p.a -> q (body) -> p.a"),
        ("from q import y\n", "", "p.a -> q -> p.a"),
        ("x = 1\n", "from p.a import x\n", ""),
    ],
)
def test_circles_are_found(tmp_path: Path, one: str, other: str, names: str) -> None:
    for name, text in {
        "p/__init__.py": "", "p/a.py": one, "p/b.py": other, "q/__init__.py": "from p.a import x\n", "q/c.py": "",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert " -> ".join(circle(graph(modules(tmp_path, ("p", "q"))))) == names


def beyond(tree: ast.Module, allowed: Mapping[str, str]) -> list[str]:
    """Imports of the two packages that are neither public names nor `allowed`."""
    public = {("errormodel", name) for name in (*errormodel.__all__, "__version__", "")}
    public |= {("identification", name) for name in (*identification.__all__, "api", "")}
    out = []
    for module, name in imported(tree):
        known = any(module == a or module.startswith(f"{a}.") or f"{module}.{name}" == a for a in allowed)
        if module.partition(".")[0] in PACKAGES and (module, name) not in public and not known:
            out.append(f"{module} {name}".strip())
    return out


@pytest.mark.parametrize("file", sorted((ROOT / "identification/command_line").glob("*.py")), ids=lambda f: f.stem)
def test_the_command_line_uses_the_public_functions_and_nothing_below(file: Path) -> None:
    assert not beyond(ast.parse(file.read_text(encoding="utf-8")), OF_COMMAND_LINE)


def test_what_the_command_line_may_import_is_no_longer_than_needed() -> None:
    trees = [ast.parse(f.read_text(encoding="utf-8")) for f in (ROOT / "identification/command_line").glob("*.py")]
    used = {f"{m}.{n}" for tree in trees for m, n in imported(tree)}
    assert [a for a in OF_COMMAND_LINE if not any(f"{u}.".startswith(f"{a}.") for u in used)] == []


def test_an_import_from_below_is_found() -> None:
    tree = ast.parse("def f():\n    from identification.estimation.fit import fit_machine\n")
    assert beyond(tree, OF_COMMAND_LINE) == ["identification.estimation.fit fit_machine"]


@pytest.mark.parametrize("file", sorted((ROOT / "notebooks").glob("*.py")), ids=lambda f: f.stem)
def test_a_notebook_uses_the_public_functions(file: Path) -> None:
    tree, allowed = ast.parse(file.read_text(encoding="utf-8")), OF_NOTEBOOKS.get(file.stem, {})
    assert not beyond(tree, allowed)
    used = {f"{m}.{n}" for m, n in imported(tree)}
    assert [a for a in allowed if not any(f"{u}.".startswith(f"{a}.") for u in used)] == []


def test_the_first_notebook_needs_two_import_lines() -> None:
    """Of the project, that is."""
    tree = ast.parse((ROOT / "notebooks/01_first_fit.py").read_text(encoding="utf-8"))
    own = [n for n in tree.body if isinstance(n, ast.ImportFrom) and str(n.module).partition(".")[0] in PACKAGES]
    assert [n.module for n in own] == list(PACKAGES)


def absent(tree: ast.Module) -> list[str]:
    """What a file imports from the project, or from its tests, and is not there."""
    missing = []
    for module, name in sorted(set(imported(tree))):
        if module.partition(".")[0] not in (*PACKAGES, "tests"):
            continue
        try:
            there = hasattr(importlib.import_module(module), name or "__name__")
            there = there or importlib.util.find_spec(f"{module}.{name}") is not None
        except ModuleNotFoundError as error:
            # A rival that a benchmark measures against, or an extra, may be absent.
            there = (error.name or "").partition(".")[0] not in (*PACKAGES, "tests")
        if not there:
            missing.append(f"{module} {name}".rstrip())
    return missing


@pytest.mark.parametrize("file", sorted((ROOT / "tests/benchmarks").glob("*.py")), ids=lambda f: f.stem)
def test_a_benchmark_imports_what_is_there(file: Path) -> None:
    """Nothing else in the test suite runs them."""
    assert not absent(ast.parse(file.read_text(encoding="utf-8")))


def test_an_absent_import_is_found() -> None:
    gone = (
        "from identification.thermal import a\nfrom identification import thermal\nfrom identification import nothing"
    )
    assert absent(ast.parse(gone)) == ["identification nothing", "identification.thermal a"]
