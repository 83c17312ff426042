"""Pages of reference, written from the code: what the program has is what they say.

``python docs/generate.py`` writes them to ``docs/reference/``; the build of the documentation does it by itself.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

from controller_pages import controller, controllers, targets
from page_table import table

HERE = Path(__file__).parent / "reference"


def write(folder: Path) -> list[Path]:
    """Write all pages; those that are as they were stay untouched."""
    pages = {
        "commands.md": commands(),
        "effects.md": effects(),
        "decision_rules.md": decision_rules(),
        "controllers.md": controllers(),
        **{f"controllers/{name}.md": controller(name) for name in targets()},
        "instruments.md": instruments(),
        "observations.md": observations(),
        "lengths.md": lengths(),
        "joint_models.md": joint_models(),
        "formats.md": formats(),
        "machine_formats.md": machine_formats(),
        "standards.md": standards(),
        "machine_keys.md": machine_keys(),
        "survey_keys.md": survey_keys(),
        "licences.md": licences(),
    }
    out = []
    for name, lines in pages.items():
        path, text = folder / name, "\n".join(lines) + "\n"
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
        out.append(path)
    return out


def commands() -> Iterator[str]:
    """Every command with its help."""
    import click

    from identification.command_line.main import app

    yield "# Commands"
    yield ""
    yield "Written from the program. `errormodel COMMAND --help` prints the same."
    for name, command in app.commands.items():
        context = click.Context(command, info_name=f"errormodel {name}", max_content_width=100)
        yield from ("", f"## {name}", "", "```text", command.get_help(context), "```")


def effects() -> Iterator[str]:
    """Every physical effect: what it does, its keys, its source, what it looks like."""
    from errormodel.effects import registry

    yield "# Effects"
    yield ""
    yield (
        "Physics beyond the rigid error motions. Each is one class in one file of `errormodel/effects/`, or comes with "
        "another package (see [how to add one](../extending.md)). The words are those of `effects:` in `machine.yaml`, "
        "of findings and of `diagnosis.json`."
    )
    families: dict[str, list[Any]] = {}
    for kind in registry().values():
        families.setdefault(kind.family, []).append(kind)
    yield ""
    yield from table(
        ("family", "effects"),
        ((f, ", ".join(f"[{k.effect}](#{k.effect})" for k in kinds)) for f, kinds in families.items()),
    )
    for family, kinds in families.items():
        yield from ("", f"## {family.capitalize()} effects")
        for kind in kinds:
            keys = ", ".join(f"`{name}`" for name in kind.model_fields) or "none"
            example = ", ".join(f"{k}: {_yaml(v)}" for k, v in {"effect": kind.effect, **kind.example}.items())
            yield from ("", f"### {kind.effect}", "", inspect.cleandoc(kind.__doc__ or ""), "")
            yield from (f"- Example: `- {{{example}}}`", f"- Keys: {keys}", f"- Source: {kind.source}")
            if kind.alike:
                yield f"- Can look like: {', '.join(kind.alike)}"
            yield f"- Distinguished by this measurement: {kind.separate}"
            if kind.asked:
                values = " and ".join(f"{count} values of `{c}`" for c, count in kind.asked.items())
                yield f"- Where a survey has {values}: {kind.otherwise}"


def decision_rules() -> Iterator[str]:
    """Every rule that decides in a diagnosis, by stage, with the constants of its thresholds."""
    from importlib import import_module

    from identification.diagnosis.decisions import constants
    from identification.diagnosis.decisions.rules import RULES
    from identification.diagnosis.decisions.stages import STAGES

    yield "# Rules of the diagnosis"
    yield ""
    yield "The names stand in `decisions.csv` and in what `errormodel explain` prints."
    yield from ("", "## Constants that decide", "")
    whys = docstrings(constants)
    yield from table(("constant", "value", "derivation or calibration"), [(f"`{n}`", v, why) for n, v, why in whys])
    for stage, what in STAGES.items():
        rows = []
        for name, rule in RULES.items():
            if rule.stage == stage:
                places = (constant.rpartition(".") for constant in rule.constants)
                values = (
                    f"`{own}` = {getattr(import_module(f'identification.diagnosis.{module}'), own)} (`{module}`)"
                    for module, _, own in places
                )
                rows.append((f"`{name}`", rule.decides, rule.scale, "; ".join(values)))
        yield from ("", f"## {stage.capitalize()}", "", f"{what[0].upper()}{what[1:]}.", "")
        yield from table(("rule", "what it decides", "scale of its value", "constants"), rows)


def docstrings(module: ModuleType) -> Iterator[tuple[str, object, str]]:
    """Each constant of a module with its value, and the string that follows it."""
    body = ast.parse(inspect.getsource(module)).body
    for one, following in pairwise(body):
        if isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name) and isinstance(following, ast.Expr):
            name = one.targets[0].id
            yield name, getattr(module, name), " ".join(str(ast.literal_eval(following.value)).split())


def instruments() -> Iterator[str]:
    """Every instrument and its keys."""
    from errormodel.instruments import instruments as registry

    yield "# Instruments"
    yield ""
    yield "What `instrument:` in a `survey.yaml` may be. Each is one class in `errormodel/instruments/`."
    for name, kind in registry().items():
        yield from ("", f"## {name}", "", inspect.cleandoc(kind.__doc__ or ""), "")
        yield from _fields(kind)


def observations() -> Iterator[str]:
    """Every observation model of single readings and its keys."""
    from errormodel.observations import registry

    yield "# Observations"
    yield ""
    yield (
        "What an entry of `observations:` in a `survey.yaml` may be. Each is one class in one file of "
        "`errormodel/observations/`, or comes with another package (see [how to add one](../extending.md)). How they "
        "are used: [lengths, angles and planes](../lengths.md)."
    )
    for name, kind in registry().items():
        example = ", ".join(f"{k}: {_yaml(v)}" for k, v in {"type": name, **kind.example}.items())
        yield from ("", f"## {name}", "", inspect.cleandoc(kind.__doc__ or ""), "")
        yield f"- Column: `{kind.reading}`" + (", with `from_<joint>` for the first pose" if kind.poses > 1 else "")
        yield f"- Shows {kind.sees}"
        yield from (f"- Example: `{{{example}}}`", f"- Source: {kind.source}", "")
        yield from _fields(kind)


def lengths() -> Iterator[str]:
    """What lengths alone can identify of three machines, computed."""
    import length_ranks

    machines = length_ranks.MACHINES
    yield "# What lengths alone can identify"
    yield ""
    yield (
        "Groups of parameters of three machines that a set-up identifies, by the rank of its design matrix at "
        f"{length_ranks.POSES} random poses a station, or on circles, after what frames, stations, dead paths and "
        "lengths of bars imitate is taken out. Rigid motions of the whole machine show only where stations are known "
        "in its own frame. Behind the number: error motions of which a tracker shows a group that this set-up does "
        "not determine by itself."
    )
    yield ""
    rows = []
    for words, ranks in length_ranks.table():
        cells = [f"{r.groups}" + (f" (not alone: {length_ranks.motions(r.unseen)})" if r.unseen else "") for r in ranks]
        rows.append((words, *cells))
    yield from table(("set-up", *(f"`{m}`" for m in machines)), rows)


def joint_models() -> Iterator[str]:
    """Every error model of a joint and what its number counts."""
    from errormodel.joint_models import registry

    yield "# Joint error models"
    yield ""
    yield (
        "What `errors: {joints: ...}` in a `machine.yaml` may say of an error motion, beside `none`. Each is one class "
        "in one file of `errormodel/joint_models/`, or comes with another package (see [how to add one]"
        "(../extending.md))."
    )
    for word, kind in registry().items():
        written = f"`{{{word}: n}}`, n the {kind.counts}" if kind.counts else f"`{word}`"
        yield from ("", f"## {word}", "", inspect.cleandoc(kind.__doc__ or ""), "")
        yield f"- Written: {written}"
        yield f"- Joints: {', '.join(kind.joints)}"
        yield f"- Source: {kind.source}"


def formats() -> Iterator[str]:
    """Every format of survey tables with its suffixes."""
    from errormodel.formats import SUFFIXES, module_of
    from errormodel.raw_formats.base import raw_formats

    yield "# Formats of survey tables"
    yield ""
    yield "What a survey, or `path:` of a `survey.yaml`, may be, by its suffix; a folder of such files is one table."
    yield ""
    rows: dict[str, list[str]] = {}
    for suffix in SUFFIXES:
        rows.setdefault((inspect.getdoc(module_of(suffix)) or "").partition("\n")[0], []).append(f"`{suffix}`")
    yield from table(("suffixes", "what they are"), ((", ".join(names), text) for text, names in rows.items()))
    yield from ("", "# Raw formats", "", "What `errormodel import`, or `format:` in a `survey.yaml`, reads.", "")
    for name, kind in raw_formats().items():
        tried = "tried on a public recording" if kind.seen else "written to this description, not tried on a recording"
        yield from (f"## {name}", "", inspect.getdoc(kind) or "", "", f"Source: {kind.source}; {tried}.", "")


def machine_formats() -> Iterator[str]:
    """Every format of descriptions of machines."""
    from errormodel.machine_formats.base import registry

    yield from ("# Formats of robot descriptions", "")
    yield (
        "What `errormodel machine` reads and `errormodel export` writes. Each is one class in "
        "`errormodel/machine_formats/`. How they are used: [robots](../robots.md)."
    )
    for name, kind in registry().items():
        title = f"{kind.title[2].upper()}{kind.title[3:]}."
        yield from ("", f"## {name}", "", title, "", inspect.getdoc(kind) or "", "", f"Source: {kind.source}.")


def machine_keys() -> Iterator[str]:
    """Keys of ``machine.yaml``."""
    from errormodel.machine_file import MachineForm

    yield from ("# Keys of machine.yaml", "")
    yield from _fields(MachineForm)


def standards() -> Iterator[str]:
    """Every standard of tests: what it is, and what it needs."""
    import sys

    from identification.iso_standards import registry

    yield from ("# Standards of tests", "")
    yield (
        "Each is one file of `identification/iso_standards/`, and a word of `errormodel iso`. How they are used: "
        "[standards and certificates](../standards.md)."
    )
    for number, kind in registry().items():
        survey, fit = kind.takes()
        yield from ("", f"## {number}", "", kind.title + ".", "")
        yield inspect.getdoc(sys.modules[kind.__module__]) or ""
        yield ""
        if survey:
            yield f"Of a survey: {kind.needs}."
        if fit:
            yield "Of a fitted model: the folder of `fit`, `diagnose` or `thermal`."


def survey_keys() -> Iterator[str]:
    """Keys of ``survey.yaml``, and the columns of its tables."""
    from errormodel.surveys.file import SurveyForm
    from errormodel.surveys.record import (
        AmbientRecord,
        InstrumentRecord,
        MachineRecord,
        RecordForm,
        UncertaintyRecord,
    )

    yield from ("# Keys of survey.yaml", "")
    yield from _fields(SurveyForm)
    blocks = {
        "test": RecordForm,
        "test.machine": MachineRecord,
        "test.instrument": InstrumentRecord,
        "test.ambient": AmbientRecord,
        "test.uncertainty": UncertaintyRecord,
    }
    for name, form in blocks.items():
        yield from ("", f"## {name}", "")
        yield from _fields(form)


def licences() -> Iterator[str]:
    """Every package that comes with errormodel in this environment, with its licence."""
    from importlib.metadata import version

    sys.path.append(str(HERE.parents[1]))  # of the repository, where the check of all licences is
    from tests.helpers.licences import EXCEPTIONS, requirements, tree

    yield from ("# Licences", "")
    exceptions = ", ".join(f"{name} ({licence})" for name, licence in EXCEPTIONS.items())
    yield (
        "What `pip install errormodel` and each extra install, with the licence that each package states, from the "
        "environment in which these pages were built, on Linux. `python -m tests.helpers.licences` fails at one that "
        f"asks more of a user than Apache-2.0 does. The exception is {exceptions}, a library on its own that is "
        "imported at run time, unmodified, and can be exchanged. A release has the same list as a bill of materials "
        "(CycloneDX) beside the wheel."
    )
    listed: set[str] = set()
    for extra in ("", "arviz", "big", "clouds", "fleet", "xlsx", "dev"):
        found = sorted(tree(requirements(extra)))
        rows = [(n, "" if text == "not installed" else version(n), text) for n, text in found if n not in listed]
        listed.update(n for n, _ in found)
        title = f"`[{extra}]`, beside those above" if extra else "`errormodel`"
        yield from ("", f"## {title}", "", *table(("package", "version", "licence"), rows))


def _fields(model: Any) -> Iterator[str]:
    rows = []
    for name, field in model.model_fields.items():
        default = "required" if field.is_required() else f"`{field.get_default(call_default_factory=True)!r}`"
        rows.append((f"`{name}`", field.description or "", default if len(default) < 80 else "see the description"))
    yield from table(("key", "what to write", "where it is left out"), rows)


def _yaml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: {_yaml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    return str(value)


if __name__ == "__main__":
    for page in write(HERE):
        print(page)  # noqa: T201  a script's own output
