"""The real LinuxCNC, headless: configuration, one programme run through it, positions as HAL sampled them.

It runs as the distribution installs it (``linuxcnc-uspace``), with simulated time where there is no realtime. A name
space of its own keeps its shared memory, ports and processes apart, where the system allows one.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import tempfile
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from errormodel.controllers.linuxcnc_3d import COMPONENT, PREFIX
from errormodel.controllers.setup import Setup
from tests.helpers.chains import Array

EDGES = 2e-3  # s: the servo cycles in which a standstill begins and ends may not be sampled as such
DWELL = 0.05  # s at each place, counted in servo cycles: a busy computer runs these late and in bursts
RUN_CYCLES = 120_000  # servo cycles of a run at most, two minutes of the controller's own time; usual are 5 to 20 s
PATIENCE = 120  # s of the computer without any servo cycle, after which a run has failed
RUN_SECONDS = 900  # of the computer: nothing that hangs stays for ever
SPEED = 5000.0  # mm/s and deg/s, with forty times as much a second: a run over a mill's travels takes seconds
ACCELERATE = 40.0
LAST_LINE = 1  # output of the controller that a programme switches on when it has come to its end
MARK = "ERRORMODEL_LINUXCNC_RUN"  # in the environment of every process of a run
LOCK = Path("/tmp/linuxcnc.lock")  # LinuxCNC's own
MODULES = Path("/usr/lib/linuxcnc/modules")
APART = ("unshare", "--pid", "--ipc", "--net", "--mount", "--fork", "--kill-child", "--mount-proc")


def needed(*programs: str) -> None:
    """Skip the test where LinuxCNC is not installed, or runs already."""
    for program in ("linuxcnc", "halsampler", *programs):
        if shutil.which(program) is None:
            package = "linuxcnc-uspace-dev" if program == "halcompile" else "linuxcnc-uspace"
            pytest.skip(f"{program} is not installed (package {package})")


@dataclass(frozen=True)
class Controller:
    """A configuration: kinematics of linear axes, position loops closed in HAL, no homing moves.

    Attributes
    ----------
    setup : letters, numbers and travels of the axes.
    ini : lines of the joints' sections, by section, such as those of a file of screw errors.
    hal : lines of HAL after the joints' own signals.
    driven : signals of HAL that carry the motor positions of axes whose letters they have; `hal` makes them.
    pins : further HAL pins that are sampled, with their types (``f`` float, ``s`` s32, ``b`` bit).
    component : a component of HAL that `hal` loads, or the kinematics.
    kinematics : module of the kinematics; empty: trivkins.
    speed : of every axis, mm/s or deg/s.
    """

    setup: Setup
    ini: Mapping[str, Sequence[str]] = field(default_factory=dict)
    hal: str = ""
    driven: Mapping[str, str] = field(default_factory=dict)
    pins: Mapping[str, str] = field(default_factory=dict)
    component: Path | None = None
    speed: float = SPEED
    kinematics: str = ""

    @property
    def letters(self) -> list[str]:
        """Letters of the joints, by number."""
        return [a.name for a in self.setup.ordered]

    @classmethod
    def of(
        cls,
        setup: Setup,
        files: Mapping[str, str],
        component: Path | None = None,
        pins: Mapping[str, str] | None = None,
        speed: float = SPEED,
    ) -> Controller:
        """The configuration of a person who follows the checklist of the files that `compensate` wrote."""
        if "compensation.ini" in files:
            matrix = files.get("matrix.hal", "")
            kinematics = "matrixkins" if matrix else ""
            joints = joint_sections(files["compensation.ini"])
            return cls(setup, joints, matrix, component=component, speed=speed, kinematics=kinematics)
        corrected = {m: f"{PREFIX}-{m}-out" for m in setup.movers}
        # a drive that is where it was told to be
        loops = [f"net {s} {PREFIX}.{m}.motor-out => {PREFIX}.{m}.feedback-in" for m, s in corrected.items()]
        hal = "\n".join([files[f"{COMPONENT}.hal"], *loops])
        return cls(setup, hal=hal, driven=corrected, pins=pins or {}, component=component, speed=speed)

    def stands(self, folder: Path, places: Array) -> tuple[Array, Array, Samples]:
        """Positions and motors (n, axes) in the setup's order at the places (n, joints), and all samples."""
        samples = self.run(folder, stop_programme(self.letters, places))
        order = [self.letters.index(a.name) for a in self.setup.axes]
        position, motor = samples.stops(places)
        return position[:, order], motor[:, order], samples

    def ini_text(self) -> str:
        parts = {
            "EMC": ["VERSION = 1.1", "MACHINE = test", "DEBUG = 0"],
            "DISPLAY": ["DISPLAY = ./display.py"],
            "TASK": ["TASK = milltask", "CYCLE_TIME = 0.001"],
            "RS274NGC": ["PARAMETER_FILE = test.var"],
            "EMCMOT": ["EMCMOT = motmod", f"COMM_TIMEOUT = {PATIENCE}", "SERVO_PERIOD = 1000000"],
            "HAL": ["HALFILE = test.hal"],
            "EMCIO": ["EMCIO = io", "CYCLE_TIME = 0.1", "TOOL_TABLE = test.tbl"],
            "TRAJ": [
                f"COORDINATES = {' '.join(self.letters)}", "LINEAR_UNITS = mm", "ANGULAR_UNITS = degree",
                f"MAX_LINEAR_VELOCITY = {self.speed}", f"DEFAULT_LINEAR_VELOCITY = {self.speed}",
            ],
            "KINS": [
                f"KINEMATICS = {self.kinematics or 'trivkins coordinates=' + ''.join(self.letters)}",
                f"JOINTS = {len(self.letters)}",
            ],
        }  # fmt: skip
        for k, axis in enumerate(self.setup.ordered):
            low, high = axis.travel
            limits = [
                f"MIN_LIMIT = {low - 0.01:.6f}", f"MAX_LIMIT = {high + 0.01:.6f}",
                f"MAX_VELOCITY = {self.speed}", f"MAX_ACCELERATION = {ACCELERATE * self.speed}",
            ]  # fmt: skip
            home = f"HOME = {(low + high) / 2:.6f}", f"HOME_OFFSET = {(low + high) / 2:.6f}"
            parts[f"AXIS_{axis.name}"] = limits
            parts[f"JOINT_{k}"] = [
                f"TYPE = {'ANGULAR' if axis.rotary else 'LINEAR'}", *limits, *home, "HOME_SEQUENCE = 0",
                "FERROR = 100", "MIN_FERROR = 100", *self.ini.get(f"JOINT_{k}", ()),
            ]  # fmt: skip
        return "\n".join("\n".join([f"[{name}]", *lines, ""]) for name, lines in parts.items())

    def hal_text(self) -> str:
        count = len(self.letters)
        lines = [
            "loadrt [KINS]KINEMATICS",
            f"loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints={count}",
            f"loadrt sampler depth=60000 cfg=sb{'ff' * count}{''.join(self.pins.values())}",
            "setp sampler.0.enable 0",
            "loadrt timedelay",
            f"setp timedelay.0.on-delay {DWELL + EDGES}",
            "setp timedelay.0.off-delay 0",
            "addf motion-command-handler servo-thread",
            "addf motion-controller servo-thread",
            "addf timedelay.0 servo-thread",
            "net user-enable iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
            "net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared",
            "net change iocontrol.0.tool-change => iocontrol.0.tool-changed",
            "net line motion.program-line => sampler.0.pin.0",
            "net still motion.in-position => sampler.0.pin.1 timedelay.0.in",
            "net stood timedelay.0.out => motion.digital-in-00",
        ]
        for k, letter in enumerate(self.letters):
            linked = re.search(rf"^net (\S+) .*\bjoint\.{k}\.pos-cmd\b", self.hal, re.MULTILINE)
            position = linked[1] if linked else f"position-{k}"  # a pin has one signal
            lines.append(f"net {position} joint.{k}.pos-cmd => sampler.0.pin.{2 + 2 * k}")
            if letter in self.driven:
                lines.append(f"net {self.driven[letter]} => sampler.0.pin.{3 + 2 * k}")
            else:
                source = f"joint.{k}.motor-pos-cmd => joint.{k}.motor-pos-fb"
                lines.append(f"net motor-{k} {source} sampler.0.pin.{3 + 2 * k}")
        lines += [self.hal]
        lines += [f"net sampled-{k} {pin} => sampler.0.pin.{2 + 2 * count + k}" for k, pin in enumerate(self.pins)]
        return "\n".join([*lines, "addf sampler.0 servo-thread", ""])

    def run(self, folder: Path, programme: str) -> Samples:
        """Run a programme, and return what HAL sampled in every servo cycle.

        Raises
        ------
        AssertionError
            The controller refused something, or did not reach the programme's last line.
        """
        files = {"test.ini": self.ini_text(), "test.hal": self.hal_text(), "test.tbl": "", "programme.ngc": programme}
        for name, text in {**files, "limits.txt": f"{RUN_CYCLES} {PATIENCE}"}.items():
            (folder / name).write_text(text)
        shutil.copy(Path(__file__).with_name("linuxcnc_display.py"), folder / "display.py")
        (folder / "display.py").chmod(0o755)
        with alone() as apart, tempfile.TemporaryDirectory() as sockets:
            said = _run("linuxcnc -r test.ini", folder, sockets, apart, RUN_SECONDS, self.component)
        found = folder / "errors.txt"
        assert found.exists(), f"LinuxCNC did not start: {said[-3000:]}"
        assert found.read_text() == "", f"{found.read_text()}\n{said[-3000:]}"
        return Samples.of(folder, len(self.letters))


@dataclass(frozen=True)
class Samples:
    """Of n servo cycles: programme line, whether all axes stand, positions and motors (n, joints), other pins."""

    line: Array
    still: Array
    position: Array
    motor: Array
    other: Array
    pins: Mapping[str, str]  # of all HAL pins at the end

    @classmethod
    def of(cls, folder: Path, joints: int) -> Samples:
        text = (folder / "samples.txt").read_text()
        assert "overrun" not in text
        data = np.array([line.split() for line in text.splitlines()], dtype=np.float64)
        pins = [line.split() for line in (folder / "pins.txt").read_text().splitlines()]
        both = data[:, 2 : 2 + 2 * joints]
        values = {p[4]: p[3] for p in pins if len(p) > 4}
        # an encoder that counts from where the axis stood at the start is no part of a correction
        zero = [float(values[f"joint.{k}.motor-offset"]) for k in range(joints)]
        return cls(data[:, 0], data[:, 1] > 0, both[:, ::2], both[:, 1::2] - zero, data[:, 2 + 2 * joints :], values)

    def stops(self, wanted: Array) -> tuple[Array, Array]:
        """Positions and motors (n, joints) at the end of the standstill at each of the wanted positions, in order.

        Raises
        ------
        AssertionError
            The programme did not stand there for its dwell.
        """
        out, start = [], 0
        for place in wanted:
            here = self.still[start:] & (np.abs(self.position[start:] - place).max(axis=1) < 1e-6)
            first = np.flatnonzero(here)
            assert len(first), f"never stood at {place}"
            after = np.flatnonzero(~here[first[0] :])
            stood = int(after[0]) if len(after) else len(here) - int(first[0])
            assert stood >= round(DWELL / 1e-3), f"{stood} servo cycles only at {place}"
            start += int(first[0]) + stood
            out.append(start - 1)
        return self.position[out], self.motor[out]


def joint_sections(text: str) -> dict[str, list[str]]:
    """Lines of each section of ``compensation.ini``, as a person copies them into the INI file."""
    out: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            out[line.strip("[]")] = []
        elif not line.startswith("#"):
            out[list(out)[-1]].append(line)
    return out


def built(folder: Path) -> Path:
    """The component of the 3-D tables as LinuxCNC's own tool builds it, without a warning."""
    source = Path(__file__).parents[2] / "errormodel/controllers/linuxcnc_3d.c"
    shutil.copy(source, folder / f"{COMPONENT}.c")
    done = compiled(folder / f"{COMPONENT}.c")
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr + done.stdout
    return folder / f"{COMPONENT}.so"


def compiled(source: Path) -> subprocess.CompletedProcess[str]:
    """A component built with halcompile beside its source."""
    command = ["halcompile", "--compile", source.name]
    return subprocess.run(command, cwd=source.parent, capture_output=True, text=True, check=False)


def halrun(folder: Path, script: str, component: Path | None = None, seconds: float = PATIENCE) -> str:
    """What a script of HAL prints, without the controller."""
    (folder / "test.hal").write_text(script)
    with alone() as apart, tempfile.TemporaryDirectory() as sockets:
        return _run("halrun -f test.hal", folder, sockets, apart, seconds, component)


def stop_programme(letters: Sequence[str], places: Array) -> str:
    """A programme that goes to each place (n, joints), mm and deg of the machine, and stands there for `DWELL`.

    G4 would not do: its time is the computer's, and it may begin by the controller's state before a move that has just
    been queued; on a busy computer it is over before the move is. Here an input of HAL says that all axes have stood
    for the dwell. Two commands which the motion controller takes in servo cycles of their own come before, so that the
    input is no older than the move.
    """
    lines = ["G21 G90 G94 G40 G49 G80"]
    for place in places:
        words = " ".join(f"{n}{v:.6f}" for n, v in zip(letters, place, strict=True))
        lines += [f"G53 G0 {words}", "M64 P0", "M65 P0", f"M66 P0 L3 Q{RUN_SECONDS}"]
    return "\n".join([*lines, f"M64 P{LAST_LINE}", "M2", ""])


@contextmanager
def alone() -> Iterator[bool]:
    """One controller at a time on this computer; yields whether it can have a name space of its own."""
    import fcntl  # not on every system

    with (Path(tempfile.gettempdir()) / "errormodel-linuxcnc.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if LOCK.exists():
            pytest.skip(f"LinuxCNC runs on this computer already, or did not end well ({LOCK})")
        try:
            tried = shutil.which(APART[0]) and subprocess.run([*APART, "true"], capture_output=True, check=False)
            yield bool(tried) and tried.returncode == 0
        finally:
            LOCK.unlink(missing_ok=True)


def _run(program: str, folder: Path, sockets: str, apart: bool, seconds: float, component: Path | None = None) -> str:
    """Run a program of LinuxCNC on the files of a folder until it ends; what it printed."""
    run = Path(sockets) / "run"  # where every user gets at it
    shutil.copytree(folder, run)
    run.chmod(0o755)
    before = "ip link set lo up 2>/dev/null"
    if component is not None:  # LinuxCNC loads from one folder only: it gets a copy with the component in it
        if not apart:
            pytest.skip("a component can be loaded in a name space of its own only, which needs root")
        shutil.copytree(MODULES, Path(sockets) / "modules")
        shutil.copy(component, Path(sockets) / "modules")
        before += f"; mount --bind {sockets}/modules {MODULES}"
    mark = uuid.uuid4().hex
    own = {"HOME": str(run), "CONFIG_DIR": str(run), "RTAPI_FIFO_PATH": f"{sockets}/rtapi", MARK: mark, "DISPLAY": ""}
    if os.getuid() == 0:  # rtapi_app does not serve root himself; `nobody` must get at its socket
        own["RTAPI_UID"] = "65534"
        Path(sockets).chmod(0o777)
    command = ["sh", "-c", f"exec {program}"]
    if apart:
        command = [*APART, "sh", "-c", f"{before}; exec {program}"]
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | own
    log = folder / "log.txt"
    with log.open("w") as out:
        running = subprocess.Popen(
            command, cwd=run, env=env, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True
        )
        try:
            running.wait(seconds)
        except subprocess.TimeoutExpired:
            out.write("no end in time\n")
        finally:
            running.kill()  # a name space dies with its first process
            running.wait()
            if not apart:
                _end_all(mark)
                subprocess.run(["halrun", "-U"], env=env, cwd=run, capture_output=True, timeout=20, check=False)
    for written in ("samples.txt", "errors.txt", "pins.txt"):
        if (run / written).exists():
            shutil.copy(run / written, folder)
    return log.read_text(errors="replace")


def left_behind(mark: str = "") -> list[int]:
    """Processes of a run (of any run) that still live, known by the mark in their environment."""
    wanted, out = f"{MARK}={mark}".encode(), []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if any(v.startswith(wanted) for v in (process / "environ").read_bytes().split(b"\0")):
                out.append(int(process.name))
        except OSError:
            continue  # it has ended, or is not ours
    return out


def _end_all(mark: str) -> None:
    for process in left_behind(mark):
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
