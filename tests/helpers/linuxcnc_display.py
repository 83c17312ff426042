#!/usr/bin/python3
"""Takes the place of a user interface of LinuxCNC: homes, runs ``programme.ngc`` while HAL is sampled, and ends.

Runs on the system's own Python, which has LinuxCNC's module; writes ``samples.txt``, ``errors.txt`` and ``pins.txt``.
"""

import pathlib
import subprocess
import sys
import time

import hal
import linuxcnc

CYCLES, PATIENCE = map(int, pathlib.Path("limits.txt").read_text().split())
LAST_LINE = 1  # output that the programme switches on at its end
command, stat, errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()
clock = hal.component("clock")  # HAL answers components only
clock.ready()


def until(reached, what):
    """Poll until the state is reached; the controller's own errors end the run, and so does its standstill."""
    seen, since = -1, time.monotonic()
    while True:
        stat.poll()
        found = errors.poll()
        if found and found[0] in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
            sys.exit(f"{what}: {found[1]}")
        if reached():
            return
        cycles = hal.get_value("sampler.0.sample-num")
        if cycles != seen:
            seen, since = cycles, time.monotonic()
        if cycles > CYCLES:
            sys.exit(f"{what}: no end within {CYCLES} servo cycles")
        if time.monotonic() - since > PATIENCE:
            sys.exit(f"{what}: nothing for {PATIENCE} s, after {cycles} servo cycles")
        time.sleep(0.005)


def done(what):
    """Wait until the controller has taken the last command."""
    if command.wait_complete(PATIENCE) != linuxcnc.RCS_DONE:
        sys.exit(f"{what}: not taken within {PATIENCE} s")


def ended():
    """Whether the programme has come to its last line, and all axes stand."""
    return stat.dout[LAST_LINE] and stat.interp_state == linuxcnc.INTERP_IDLE and stat.inpos


def run():
    command.state(linuxcnc.STATE_ESTOP_RESET)
    done("emergency stop off")
    command.state(linuxcnc.STATE_ON)
    until(lambda: stat.task_state == linuxcnc.STATE_ON, "machine on")
    command.mode(linuxcnc.MODE_MANUAL)
    done("manual mode")
    command.home(-1)
    until(lambda: all(stat.homed[: stat.joints]), "home")
    command.mode(linuxcnc.MODE_AUTO)
    done("automatic mode")
    command.program_open("programme.ngc")
    done("open the programme")
    with pathlib.Path("samples.txt").open("w") as out:
        sampling = subprocess.Popen(["halsampler"], stdout=out)
        try:
            hal.set_p("sampler.0.enable", "1")
            command.auto(linuxcnc.AUTO_RUN, 0)
            until(ended, "programme")
            with pathlib.Path("pins.txt").open("w") as pins:
                subprocess.run(["halcmd", "-s", "show", "pin"], stdout=pins, check=False)
            hal.set_p("sampler.0.enable", "0")
            # halsampler writes no more of what it has not read yet once it is told to end
            until(lambda: hal.get_value("sampler.0.curr-depth") == 0, "samples")
        finally:
            sampling.terminate()
            sampling.wait()


try:
    run()
    said = ""
except SystemExit as end:
    said = str(end)
pathlib.Path("errors.txt").write_text(said)
