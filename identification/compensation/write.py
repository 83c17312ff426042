"""Writing a compensation to disk: the controller's files, the sign test, the checklist and ``compensation.json``."""

from __future__ import annotations

from pathlib import Path

from errormodel.controllers.base import Controller
from errormodel.files import write_bytes_atomic, write_text_atomic
from identification.compensation.kinematic_description import DESCRIPTION, description_text
from identification.compensation.result import Compensation
from identification.compensation.text import COMMON_FILES, compensation_lines
from identification.results.json_text import dumps
from identification.results.terminal import one_line


def write_compensation(result: Compensation, folder: Path) -> None:
    """Write every file to an empty folder."""
    for stated in result.sets:
        for name, text in stated.files.items():  # comments of a programme keep the bytes that they were read from
            write_bytes_atomic(text.encode("utf-8", "surrogateescape"), folder / stated.label / name)
    for more in (result.thermal, result.probing):
        for name, text in (more.files if more else {}).items():
            write_text_atomic(text, folder / name)
    if result.rotary and result.rotary.asked and isinstance(result.controller, Controller):
        heading = [f"errormodel: {one_line(result.setup.machine)}, for {result.controller.title}"]
        steps = result.controller.describe(result.rotary.lines, result.setup)
        write_text_atomic(description_text(result.rotary, heading, steps), folder / DESCRIPTION)
    for name, text in result.tests.items():
        write_text_atomic(text, folder / "sign_test" / name)
    *lines, _, _ = compensation_lines(result, Path())  # the last two name the folder, which may be moved
    write_text_atomic("\n".join(lines) + "\n", folder / COMMON_FILES[0])
    write_text_atomic(dumps(result.as_json()), folder / COMMON_FILES[1])
