"""The documentation keeps its word: its Python runs, its pages of reference have all that the program has."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from errormodel.controllers import registry as controllers
from errormodel.effects import registry as effects
from errormodel.instruments import instruments
from errormodel.machine_formats.base import registry as machine_formats
from errormodel.observations import registry as observations
from tests.helpers.interpreter import Interpreter, interpreter
from tests.helpers.licences import requirements, tree

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
KINDS = {
    "effects": effects(), "instruments": instruments(), "observations": observations(),
    "machine_formats": machine_formats(),
}  # fmt: skip
MOST_LINES = 150  # of the README: a manual is a page of docs/


def snippets() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        found += [(f"{page.name}-{k}", block) for k, block in enumerate(blocks)]
    return found


@pytest.fixture(scope="module")
def reader() -> Iterator[Interpreter]:
    """A process that runs what is on the pages."""
    with interpreter() as started:
        yield started


@pytest.mark.parametrize(
    "snippet",
    [
        pytest.param(text, id=name, marks=[pytest.mark.long] if name.startswith("fleets.md") else [])
        for name, text in snippets()
    ],
)
def test_python_of_the_pages_runs(snippet: str, reader: Interpreter, tmp_path: Path) -> None:
    reader.python(snippet, tmp_path)


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= MOST_LINES


def linked(page: Path) -> list[str]:
    """Files that a page links to."""
    return re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))


def _page(folder: Path, name: str) -> str:
    return (folder / name).read_text(encoding="utf-8")


@pytest.mark.long
def test_pages_of_reference_have_all(tmp_path: Path) -> None:
    code = "import sys; sys.path.insert(0, 'docs'); import generate, pathlib; generate.write(pathlib.Path(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, check=True)
    # every page that another one names is written, and what is written links to what is there
    named = [n for p in PAGES for n in re.findall(r"\{doc\}`[^`<]+<reference/(\w+)>`", p.read_text(encoding="utf-8"))]
    assert len(named) > 5
    assert [n for n in named if not (tmp_path / f"{n}.md").exists()] == []
    for written in tmp_path.rglob("*.md"):
        up = (ROOT / "docs" / "reference" / written.relative_to(tmp_path)).parent
        beside = [t for t in linked(written) if not ((written.parent / t).exists() or (up / t).resolve().exists())]
        assert beside == [], written.name
    for page, words in KINDS.items():
        text = (tmp_path / f"{page}.md").read_text(encoding="utf-8")
        assert [word for word in words if not re.search(rf"^### ?{word}$|^## {word}$", text, re.MULTILINE)] == []
    parts = ("What it needs", "To load", "To test", "To take it back")  # each with something behind it
    for name in controllers():
        text = (tmp_path / "controllers" / f"{name}.md").read_text(encoding="utf-8")
        assert [p for p in parts if not re.search(rf"^## {p}\n\n\S.{{20,}}", text, re.MULTILINE)] == [], name
        assert f"(controllers/{name}.md)" in (tmp_path / "controllers.md").read_text(encoding="utf-8")
    computed = re.findall(
        r"^\| ([^|]+) \| (\d+)[^|]*\| (\d+)[^|]*\| (\d+)", _page(tmp_path, "lengths.md"), re.MULTILINE
    )
    printed = re.findall(
        r"^\| ([^|]+) \| (\d+) \| (\d+) \| (\d+) \|$", _page(ROOT / "docs", "lengths.md"), re.MULTILINE
    )
    assert len(computed) > 10
    assert printed == computed
    keys = (tmp_path / "survey_keys.md").read_text(encoding="utf-8")
    assert all(f"`{key}`" in keys for key in ("files", "frame", "instrument", "columns", "units"))
    licences = (tmp_path / "licences.md").read_text(encoding="utf-8")
    assert {*tree(requirements())} <= {*re.findall(r"^\| (\S+) \| \S* \| (.+) \|$", licences, re.MULTILINE)}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    """A link leads to a file of the tree; pages written from the code are named by a role, which is no link there."""
    assert [t for t in linked(page) if not (page.parent / t).exists() or "reference/" in t] == []


def test_what_code_cites_exists() -> None:
    """Docstrings that point to a page of the documentation point to one that is there."""
    for file in [*(ROOT / "errormodel").rglob("*.py"), *(ROOT / "identification").rglob("*.py")]:
        for cited in re.findall(r"``(docs/[\w/]+\.md)``", file.read_text(encoding="utf-8")):
            assert (ROOT / cited).exists(), f"{file.name}: {cited}"
