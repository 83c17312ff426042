"""What the command line prints of an exported description."""

from __future__ import annotations

from collections.abc import Iterator

from identification.compensation.conditions import state_words
from identification.machine_export.export import READ_BACK_POSES, Exported
from identification.results.terminal import table_lines


def export_lines(done: Exported) -> Iterator[str]:
    """The description, what it holds of the fit, and what it does not."""
    joints = ", ".join(j.name for j in done.machine.joints)
    yield f"{done.machine.name}: {done.kind.name}, joints {joints}"
    yield (
        f"read back: at most {done.read_back[0]:.1e} mm and {done.read_back[1]:.1e} rad away, at {READ_BACK_POSES} "
        "random poses"
    )
    if done.calibrated is None:
        yield "nominal geometry of a machine file, which has no fit"
        return
    before, left = done.calibrated.before, done.calibrated.left
    rows = [
        ("against the fitted machine, over the measured volume, um", "rms", "worst"),
        ("  nominal geometry", f"{before.rms_um:.2f}", f"{before.worst_um:.2f}"),
        ("  this description", f"{left.rms_um:.2f}", f"{left.worst_um:.2f}"),
    ]
    rows += [
        (f"  this description, at {state_words(state)}", f"{there.rms_um:.2f}", f"{there.worst_um:.2f}")
        for state, there in done.calibrated.others
    ]
    if state := done.calibrated.state:
        another = " (another load: --load)" if "load" in state else ""
        kept = "; in other states the machine's frame is kept" if done.calibrated.others else ""
        yield f"the constants hold at {state_words(state)}{another}{kept}"
    yield ""
    yield from table_lines(rows, "<>>")
    if done.calibrated.beyond:
        yield ""
        yield "no constant, and so replaced by the nearest constants (um rms of each alone, before that)"
        parts = [(f"  {name}", f"{rms:.2f}") for name, rms in done.calibrated.beyond.items()]
        yield from table_lines(parts, "<>")
