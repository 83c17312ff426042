"""What commands write to: never what they read or did not write; folders of results whole or not at all."""

from __future__ import annotations

import ast
import os
import re
import shutil
import stat
import sys
from pathlib import Path

import pytest

from errormodel.files import sha256
from tests.helpers.commands import MILL, Fill, done, run, tree, write

ROOT = Path(__file__).resolve().parents[2]
TRUTH = "parameters: {X.dx.1: 40e-6}\n"
PRIORS = "errormodel: 1\npriors:\n  X.dx.1: {low: -1, high: 1}\n"
SURVEY = "errormodel: 1\nfiles:\n  - {path: s.csv, role: fit}\n"
SETUP = "errormodel: 1\ntravels: {X: [0, 300]}\n"
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and modes of POSIX")

# ---- one mechanism

MECHANISM = {  # what may write, and why
    "errormodel/files.py": "single files, whole or not at all",
    "identification/results/output_file.py": "a file that a command writes",
    "identification/results/results_folder.py": "a folder of results",
    "identification/bayes/netcdf.py": "through files.replacing",
    "identification/bayes/sampling.py": "pieces of a chain, through files.replacing",
    "identification/monitoring/history.py": "SQLite commits whole or not at all",
    "identification/report/pictures.py": "a temporary folder of its own",
    "identification/fleets/places.py": "copies of what is in a store, in a temporary folder",
    "identification/command_line/start.py": "the null device, in place of a closed stream",
    "identification/api/fleets.py": "a part in a temporary folder, before it is kept through a folder of results",
}
METHODS = {
    "write_text", "write_bytes", "to_csv", "to_parquet", "to_json", "to_pickle", "to_netcdf", "savefig", "unlink",
    "mkdir", "rmdir", "touch", "symlink_to", "hardlink_to", "tofile",
}  # fmt: skip
FUNCTIONS = {
    "os": {
        "rename",
        "replace",
        "remove",
        "unlink",
        "mkdir",
        "makedirs",
        "rmdir",
        "link",
        "symlink",
        "truncate",
        "fdopen",
    },
    "shutil": {"copy", "copy2", "copyfile", "copytree", "move", "rmtree"},
    "np": {"save", "savez", "savez_compressed", "savetxt"},
    "json": {"dump"},
    "pickle": {"dump"},
    "sqlite3": {"connect"},
    "h5netcdf": {"File"},
}
PLAIN_WRITERS = ("write_text_atomic", "write_csv", "write_json")
OUTPUTS = ("out", "json_file", "figures", "shown")  # names of output files in commands


SUSPECT = re.compile(  # texts without such words hold no such call
    rf"\b({'|'.join({'open', *METHODS})})\b"
    + "".join(rf"|\b{owner}\s*\.\s*({'|'.join(names)})\b" for owner, names in FUNCTIONS.items())
)


def writes(file: Path, root: Path = ROOT) -> list[str]:
    """Calls in a file that may write to the disk."""
    found = []
    text = file.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)) if SUSPECT.search(text) else ():
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        owner = ast.unparse(node.func.value) if isinstance(node.func, ast.Attribute) else ""
        arguments = [*node.args, *(k.value for k in node.keywords if k.arg in (None, "mode"))]
        modes = [a.value for a in arguments if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        opens = name == "open" and any(re.fullmatch("[rwaxbt+]+", m) and set(m) & set("wax+") for m in modes)
        in_memory = (name == "to_csv" and not node.args) or (name == "savefig" and ast.unparse(node.args[0]) == "out")
        by_method = name in METHODS and not in_memory and not (name == "write_text" and owner in OUTPUTS)
        if opens or by_method or name in FUNCTIONS.get(owner, ()):
            found.append(f"{file.relative_to(root).as_posix()}:{node.lineno} {ast.unparse(node.func)}")
    return found


def test_nothing_writes_past_the_mechanism() -> None:
    files = [p for folder in ("errormodel", "identification") for p in sorted((ROOT / folder).rglob("*.py"))]
    calls = [call for file in files for call in writes(file) if call.partition(":")[0] not in MECHANISM]
    assert not calls, (
        "write through OUT_FILE, OUT_FOLDER or OUT_TABLES of identification/command_line/console.py: " + str(calls)
    )


def test_commands_write_single_files_through_their_outputs_only() -> None:
    """The plain writers are for what an output is about to be replaced by."""
    files = sorted((ROOT / "identification/command_line").glob("*.py"))
    assert files
    for file in files:
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        items = [item for node in nodes if isinstance(node, ast.With) for item in node.items]
        bound = [i.optional_vars for i in items if re.search(r"replaced(_together)?\(", ast.unparse(i.context_expr))]
        parts = {name.id for given in bound if given for name in ast.walk(given) if isinstance(name, ast.Name)}
        for node in nodes:
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in PLAIN_WRITERS:
                assert ast.unparse(node.args[1]) in parts, f"{file.name}:{node.lineno}"


def test_the_search_for_writers_finds_them(tmp_path: Path) -> None:
    for text in ("open(p, 'w')", "p.open(mode='a')", "p.write_text('a')", "t.to_csv(p)", "os.rename(a, b)"):
        assert writes(write(tmp_path / "a.py", f"import os\n{text}\n"), tmp_path), text
    innocent = "open(p)\np.open('rb', errors='replace')\nout.write_text(t)\nt.to_csv(index=False)\n"
    assert not writes(write(tmp_path / "a.py", innocent), tmp_path)


def test_commands_name_places_to_write_as_such() -> None:
    from identification.command_line import console
    from identification.command_line.main import app

    for command in app.commands.values():
        for param in command.params:
            if param.name in ("out", "json_file", "drawing"):
                assert isinstance(param.type, console._Out), f"{command.name} {param.opts}"


# ---- what a command reads


@pytest.fixture(scope="module")
def made(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A machine, a survey, its fit and everything else that a command reads."""
    folder = with_mill(tmp_path_factory.mktemp("made"))
    source = ROOT / "machines" / f"{MILL}.yaml"
    shutil.copy(source, folder / "m.yaml")
    write(folder / "project/machine.yaml", source.read_bytes())
    write(folder / "project/s.csv", (folder / "s.csv").read_bytes())
    for name, text in {"truth.yaml": TRUTH, "priors.yaml": PRIORS, "survey.yaml": SURVEY, "setup.yaml": SETUP}.items():
        write(folder / name, text)
    for name in ("a.csv", "b.csv"):
        write(folder / "parts" / name, (folder / "s.csv").read_bytes())
    write(folder / "part.nc", "G1 X10 Y10 Z-10 F100\n")
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it to stand in."""
    shutil.copytree(made, tmp_path / "w", symlinks=True)
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


FIT = ("fit", "m.yaml", "survey.yaml", "--priors", "priors.yaml", "--out")
SIMULATE = ("simulate", "m.yaml", "survey.yaml", "--parameters", "truth.yaml", "--out")
OVER = {
    "simulate over its machine": (*SIMULATE, "m.yaml"),
    "simulate over its survey": (*SIMULATE, "survey.yaml"),
    "simulate over a file of its survey": (*SIMULATE, "s.csv"),
    "simulate over its parameters": (*SIMULATE, "truth.yaml"),
    "simulate into the parts": ("simulate", "m.yaml", "parts", "--out", "parts/c.csv"),
    "predict over its points": ("predict", "fit", "s.csv", "--out", "s.csv"),
    "predict over a file of its points": ("predict", "fit", "survey.yaml", "--out", "s.csv"),
    "predict over the fit": ("predict", "fit", "s.csv", "--out", "fit/fit.json"),
    "predict over a table of the fit": ("predict", "fit", "s.csv", "--out", "fit/parameters.csv"),
    "plan over its machine": ("plan", "m.yaml", "--points", 20, "--out", "m.yaml"),
    "plan over its setup": ("plan", "m.yaml", "--points", 20, "--setup", "setup.yaml", "--out", "setup.yaml"),
    "plan's JSON over its setup": ("plan", "m.yaml", "--points", 20, "--setup", "setup.yaml", "--json", "setup.yaml"),
    "describe over its machine": ("describe", "m.yaml", "--json", "m.yaml"),
    "describe over its survey": ("describe", "m.yaml", "s.csv", "--json", "s.csv"),
    "describe twice to one file": ("describe", "m.yaml", "--json", "d.svg", "--drawing", "./d.svg"),
    "fit into its project": ("fit", "project", "project/s.csv", "--out", "project"),
    "fit into a survey's folder": ("fit", "m.yaml", "project/s.csv", "--out", "project"),
    "fit here": ("fit", "m.yaml", "s.csv", "--out", "."),
    "fit into the parts": ("fit", "m.yaml", "parts", "--out", "parts"),
    "fit of a fit's machine into it": ("fit", "fit/machine.yaml", "s.csv", "--out", "fit"),
    "fit from a folder to its link": ("fit", "fit", "s.csv", "--out", "fit/../fit"),
    "diagnose here": ("diagnose", "project", "s.csv", "--out", "project"),
    "thermal into its project": ("thermal", "project", "s.csv", "--out", "project"),
    "compensate into its fit": ("compensate", "fit", "--controller", "csv", "--out", "fit"),
    "compensate over another fit": ("compensate", "fit", "--controller", "csv", "--out", "second"),
    "iso's JSON over its survey": ("iso", "230-2", "m.yaml", "s.csv", "--json", "s.csv"),
    "iso's JSON over the fit": ("iso", "volume", "fit", "--json", "fit/fit.json"),
    "iso into its fit": ("iso", "volume", "fit", "--out", "fit"),
    "iso over another fit": ("iso", "volume", "fit", "--out", "second"),
    "iso into its survey's folder": ("iso", "230-2", "m.yaml", "project/s.csv", "--out", "project"),
    "register over its profiler": ("register", "parts", "parts", "--profiler", "setup.yaml", "--out", "setup.yaml"),
    "register into its clouds": ("register", "parts", "parts", "--profiler", "setup.yaml", "--out", "parts/a.csv"),
}  # fmt: skip


@pytest.mark.parametrize("name", OVER)
def test_nothing_read_is_written_over(name: str, place: Path) -> None:
    shutil.copytree("fit", "second")
    before = tree(place)
    result = run(*OVER[name])
    assert result.code == 2, result.out
    assert result.err.count("\n") == 1, result.err
    assert tree(place) == before


@POSIX
@pytest.mark.parametrize("spelled", ["hard.csv", "way/s.csv", "./project/../s.csv", "soft.csv"])
def test_however_the_path_is_spelled(place: Path, spelled: str) -> None:
    os.link("s.csv", "hard.csv")
    Path("soft.csv").symlink_to("s.csv")
    Path("way").symlink_to(".", target_is_directory=True)
    before = tree(place)
    result = run("predict", "fit", "survey.yaml", "--out", spelled)
    assert result.code == 2
    assert spelled.rsplit("/", maxsplit=1)[-1] in result.err, result.err
    assert tree(place) == before


def test_refused_before_any_work(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("identification.estimation.fit.fit_machine", lambda *_, **__: 1 / 0)
    assert run("fit", "m.yaml", "survey.yaml", "--out", "project").code == 2
    write(Path("survey.yaml"), SURVEY.replace("s.csv", "project/s.csv"))
    Path("project/machine.yaml").unlink()
    result = run("fit", "m.yaml", "survey.yaml", "--out", "project")
    assert result.code == 2
    assert "project/s.csv" in result.err


READERS = {
    "fit": (*FIT, "new"),
    "simulate": (*SIMULATE, "new.csv"),
    "plan": ("plan", "m.yaml", "--points", 20, "--setup", "setup.yaml", "--out", "new.csv"),
    "predict": ("predict", "fit", "parts", "--out", "new.csv"),
    "compensate": ("compensate", "fit", "--controller", "gcode", "--program", "part.nc", "--out", "new"),
    "monitor": ("monitor", "fit", "s.csv"),
}
OPENED: list[Path] = []
WATCHING: list[bool] = []


def watch(event: str, arguments: tuple[object, ...]) -> None:
    """Note every file that Python opens to read, while a test wants to know."""
    if event == "open" and WATCHING and isinstance(arguments[0], str) and arguments[1] in ("r", "rb"):
        OPENED.append(Path(arguments[0]).resolve())


# what a plan reads is noted, or "plan over its machine" and "plan over its setup" were written over above
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.long] if n == "plan" else []) for n in READERS])
def test_every_file_that_is_opened_is_noted(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noted: list[Path] = []
    monkeypatch.setattr("errormodel.inputs.Run.refuse", lambda _, path: noted.append(path.resolve()))
    monkeypatch.setattr("errormodel.inputs.sha256", lambda _: "")  # which opens everything
    monkeypatch.setattr("identification.results.manifest.check_whole", lambda _: None)
    sys.addaudithook(watch)
    WATCHING.append(True)
    try:
        run(*READERS[name])
    finally:
        WATCHING.clear()
        opened = {p.relative_to(place) for p in OPENED if p.is_relative_to(place)}
        OPENED.clear()
    ours = (".", "monitor", "manifest.json")  # marks and what the command writes itself: no input
    read = {p for p in opened if not p.name.startswith(ours) and not p.parts[0].startswith((".new", "new"))}
    assert read
    assert read <= {p.relative_to(place) for p in noted if p.is_relative_to(place)}


# ---- what errormodel did not write


def test_single_files_are_known_by_their_content(place: Path) -> None:
    first = ("simulate", "m.yaml", 20, "--out", "new/p.csv")
    done(*first)
    made = Path("new/p.csv").read_bytes()
    done(*first)
    assert Path("new/p.csv").read_bytes() == made
    done(*first, "--seed", 5)
    assert Path("new/p.csv").read_bytes() != made
    write(Path("new/p.csv"), Path("new/p.csv").read_text().replace("0", "1"))
    changed = tree(place)
    result = run(*first)
    assert result.code == 2
    assert "p.csv" in result.err
    assert "changed since" in result.err
    write(Path("new/other.csv"), "mine\n")
    result = run("simulate", "m.yaml", 20, "--out", "new/other.csv")
    assert result.code == 2
    assert "other.csv" in result.err
    Path("new/other.csv").unlink()
    assert tree(place) == changed
    result = run("predict", "fit", "s.csv", "--out", "fit/fit.json")
    assert result.code == 2
    assert "fit.json: it is one of the results in that folder" in result.err


def test_the_record_is_what_sha256sum_reads(place: Path) -> None:
    done("simulate", "m.yaml", 20, "--out", "p.csv")
    done("describe", "m.yaml", "--json", "d.json", "--drawing", "d.svg")
    lines = dict(reversed(line.split("  ")) for line in Path(".errormodel.sha256").read_text().splitlines())
    assert {"p.csv", "d.json", "d.svg"} <= {*lines}
    assert all(sha256(Path(name)) == digest for name, digest in lines.items())


@POSIX
@pytest.mark.parametrize("what", ["pipe", "link", "dangling", "/dev/null", "/dev/stdout", ""])
@pytest.mark.parametrize("command", [("simulate", "m.yaml", 5), ("fit", "m.yaml", "s.csv")])
def test_only_plain_files_are_replaced(place: Path, what: str, command: tuple[object, ...]) -> None:
    os.mkfifo("pipe")
    Path("link").symlink_to("s.csv")
    Path("dangling").symlink_to("nowhere")
    modes = {n: os.lstat(n).st_mode for n in ("pipe", "link", "dangling", "/dev/null", "/dev/stdout")}
    result = run(*command, "--out", what)
    assert result.code == 2
    assert "Traceback" not in result.err, result.err
    assert modes == {n: os.lstat(n).st_mode for n in modes}
    assert not Path("nowhere").exists()


@POSIX
def test_permissions_stay(place: Path) -> None:
    done("simulate", "m.yaml", 20, "--out", "p.csv")
    for path, mode in (("p.csv", 0o600), ("fit", 0o700), ("fit/fit.json", 0o640)):
        Path(path).chmod(mode)
    done("simulate", "m.yaml", 30, "--out", "p.csv")
    done("fit", "m.yaml", "s.csv", "--robust", "--out", "fit")
    modes = [stat.S_IMODE(Path(p).stat().st_mode) for p in ("p.csv", "fit", "fit/fit.json")]
    assert modes == [0o600, 0o700, 0o640]


@POSIX
def test_a_link_to_a_folder_stays_one(place: Path) -> None:
    Path("way").symlink_to("fit", target_is_directory=True)
    old = tree(Path("fit"))
    done("fit", "m.yaml", "s.csv", "--robust", "--out", "way")
    assert Path("way").is_symlink()
    assert tree(Path("fit")) != old


def test_an_empty_folder_and_an_empty_file_may_be_written(place: Path) -> None:
    Path("empty").mkdir()
    write(Path("empty.csv"), "")
    done("fit", "m.yaml", "s.csv", "--out", "empty")
    done("simulate", "m.yaml", 5, "--out", "empty.csv")


def test_messages_say_what_to_do(place: Path) -> None:
    write(Path("fit/notes.txt"), "mine")
    result = run("fit", "m.yaml", "s.csv", "--out", "fit")
    assert re.search(r"fit.notes\.txt: errormodel did not write it.*Choose another folder", result.err)
