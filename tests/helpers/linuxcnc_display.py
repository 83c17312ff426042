#!/usr/bin/python3
"""Takes the place of a user interface of LinuxCNC: homes, runs ``programme.ngc`` while HAL is sampled, and ends.

Runs on the system's own Python, which has LinuxCNC's module; writes ``samples.txt``, ``errors.txt`` and ``pins.txt``.
"""

import pathlib
import subprocess
import sys
import time

import linuxcnc

END = time.monotonic() + float(pathlib.Path("seconds.txt").read_text())
command, stat, errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()


def until(reached, what):
    """Poll until the state is reached; the controller's own errors end the run."""
    while True:
        stat.poll()
        found = errors.poll()
        if found and found[0] in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
            sys.exit(f"{what}: {found[1]}")
        if reached():
            return
        if time.monotonic() > END:
            sys.exit(f"{what}: no end in time")
        time.sleep(0.005)


def run():
    command.state(linuxcnc.STATE_ESTOP_RESET)
    command.wait_complete()
    command.state(linuxcnc.STATE_ON)
    until(lambda: stat.task_state == linuxcnc.STATE_ON, "machine on")
    command.mode(linuxcnc.MODE_MANUAL)
    command.wait_complete()
    command.home(-1)
    until(lambda: all(stat.homed[: stat.joints]), "home")
    command.mode(linuxcnc.MODE_AUTO)
    command.wait_complete()
    command.program_open("programme.ngc")
    with pathlib.Path("samples.txt").open("w") as out:
        sampling = subprocess.Popen(["halsampler"], stdout=out)
        try:
            time.sleep(0.1)
            command.auto(linuxcnc.AUTO_RUN, 0)
            command.wait_complete()
            until(lambda: stat.interp_state == linuxcnc.INTERP_IDLE and stat.inpos, "programme")
            with pathlib.Path("pins.txt").open("w") as pins:
                subprocess.run(["halcmd", "-s", "show", "pin"], stdout=pins, check=False)
            time.sleep(0.1)
        finally:
            sampling.terminate()
            sampling.wait()


try:
    run()
    said = ""
except SystemExit as end:
    said = str(end)
pathlib.Path("errors.txt").write_text(said)
