"""Pages of the controllers, written from the code: what each needs, how to load, test and take back its files."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

from page_table import table


def controllers() -> Iterator[str]:
    """The list of all controllers, each with a page of its own."""
    setup = _example_setup()
    yield "# Controllers"
    yield ""
    yield (
        "Targets of `errormodel compensate --controller NAME`. Each is one class in `errormodel/controllers/`, and has "
        "a page: what it needs, how to load, to test and to take back its files. What the tables of each leave on "
        "which machine is in [Tables for a controller](../compensation.md)."
    )
    yield ""
    yield from table(
        ("name", "target", "tables of", "sign"),
        ((f"[{n}](controllers/{n}.md)", k.title, _holds(k, setup), _sign(k)) for n, k in targets().items()),
    )
    yield from ("", "```{toctree}", ":hidden:", "", *(f"controllers/{name}" for name in targets()), "```")


def controller(name: str) -> Iterator[str]:
    """One controller: its format, what no public source says of it, how to load, test and take back its files."""
    from errormodel.controllers.base import Controller

    kind, setup = targets()[name], _example_setup()
    made = kind()
    yield from (f"# {name}", "", f"**{kind.title}.** {inspect.cleandoc(kind.__doc__ or '')}", "")
    yield f"- Source: {kind.source}"
    yield f"- Not certain: {kind.doubt or 'nothing'}"
    if isinstance(made, Controller):
        holds = f"at most {made.most_points} points an axis"
        holds += f", {made.most_tables} tables" if made.most_tables else ""
        holds += ", a table for each direction of travel" if made.bidirectional else ""
        holds += ", and follows the length of the tool" if made.follows_tool else ""
        beyond = made.beyond.replace("beyond it", "beyond what was measured")
        yield f"- Holds: {_holds(kind, setup)}; {holds}; {beyond}"
        yield f"- Sign: {_sign(kind)}"
        if made.backlash_parameter:
            yield f"- Backlash: {made.backlash_parameter.format(axis='X', number=1)}"
    yield from ("", "## What it needs", "", f"{made.needs[0].upper()}{made.needs[1:]}.", "", "## To load", "")
    yield (
        "The steps of `checklist.txt` for the machine `five_axis_table_quill` of the library; that of your machine has "
        "its own axes and numbers, and what its errors need beside the tables."
    )
    yield ""
    yield from (f"{n}. {step}" for n, step in enumerate(made.checklist(setup), start=1))
    yield from ("", "## To test", "", _test(made))
    if isinstance(made, Controller):
        yield from ("", "## Rotary axes beside their place (`--kinematics`)", "", _describes(made))
    yield from ("", "## To take it back", "", f"{made.back[0].upper()}{made.back[1:]}.")


def targets() -> Any:
    """All controllers by name."""
    from errormodel.controllers import registry

    return registry()


def _describes(made: Any) -> str:
    """What the kinematic description of a control is told, in words."""
    from errormodel.controllers.base import Controller

    if not made.describes:
        return "This control has no kinematic description of rotary axes: `--kinematics` is refused."
    if type(made).describe is Controller.describe:
        return (
            "`kinematics.txt` has shift and tilt of each axis. The names of this control's own parameters for them are "
            "not public, or there are none."
        )
    what = "shift and tilt" if made.describes_tilt else "shift, and not the tilt, which is left to the tables"
    return f"`kinematics.txt` has the changes of this control's own parameters: {what}. No control has run them."


def _example_setup() -> Any:
    """A machine as controllers see it, without errors."""
    import numpy as np

    from errormodel.chain import Chain
    from errormodel.machine_file import read_machine
    from identification.compensation.field import Field, movers_of
    from identification.compensation.volume import Volume

    machine = read_machine("five_axis_table_quill")
    chain = Chain(machine)
    travel = np.array([j.travel for j in machine.joints])
    field = Field(chain, np.zeros(len(chain.ids)), movers_of(chain))
    return Volume(field, travel[:, 0], travel[:, 1], True).setup(None, None)[0]


def _holds(kind: Any, setup: Any) -> str:
    """What a format's tables are functions of, in words."""
    from errormodel.controllers.base import Controller

    if not issubclass(kind, Controller):
        return "the commands themselves"
    terms = kind().structures(setup)[-1]
    most = max(len(t.inputs) for t in terms)
    if any(t.output not in setup.movers for t in terms):
        return "error parameters of each axis"
    if most == len(setup.moving):
        return "all axes at once"
    if most > 1:
        return f"up to {most} axes at once"
    if any(t.factor for t in terms):
        return "one axis, times a second one"
    return "one axis, also another's" if any(t.inputs and t.output != t.inputs[0] for t in terms) else "its own axis"


def _sign(kind: Any) -> str:
    known = getattr(kind, "sign_known", None)
    return "" if known is None else "documented" if known else "to be tested"


def _test(made: Any) -> str:
    """How the tables are tested at the machine, in words."""
    again = "Then measure again, and give the rows to `errormodel diagnose`."
    if made.test:
        return f"{made.test}. {again}"
    language = f"; programmes `*{made.dialect.suffix}` drive there" if made.dialect else ""
    other = f" Where the other sign shows: {made.other_sign}." if made.other_sign else ""
    return (
        "`sign_test/steps.txt`, where it is written, names tables with one peak an axis, where to stand, and what an "
        f"indicator must show{language}.{other} {again}"
    )
