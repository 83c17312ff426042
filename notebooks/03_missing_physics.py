# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Finding the physics that a model left out
#
# Twelve simulated machines hold physics that their `machine.yaml` does not mention, or none at all. The simulator
# (`tests/proof/`) shares no code with the tool: finite kinematics, beams, friction and heat of its own. The truth of
# each machine is sealed: its hash is printed before the tool runs, and the file is opened afterwards. Then two
# recordings of real machines, where nobody knows the truth.
#
# As a script, this notebook shows nothing but its numbers. With `--write` it replaces the figure that the README shows
# and the example `machines/examples/gantry/`.

# %%
import json
import os
import sys
import tempfile
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt  # so that Jupyter shows figures
from matplotlib.figure import Figure

import errormodel
from errormodel.effects import make as make_effect
from errormodel.kernel import Array
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from identification.command_line.text import diagnosis_lines
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.findings import Diagnosis
from identification.estimation.result import Fit
from identification.estimation.run import fit_machine
from identification.planning.run import plan
from identification.planning.setup import Setup
from identification.planning.text import plan_lines
from identification.plots import style
from identification.plots.effect_curve import draw_effect_curve
from identification.plots.residuals_along_driver import draw_residuals_along_driver
from identification.plots.where_map import draw_where_map
from identification.report.diagnosis import numbered
from identification.results import store
from identification.results.residual_projection import evidence_of
from identification.uncertainty.prediction import predict

ROOT = Path(errormodel.__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the simulator is among the tests
from tests.proof.cases import make, write
from tests.proof.run import run_case
from tests.proof.score import Scored, failures, table
from tests.proof.seal import opened
from tests.proof.specs import all_specs

scratch = tempfile.TemporaryDirectory()
work = Path(scratch.name)

# %% [markdown]
# ## Sealed
#
# Twelve of the 330 machines of the proof: quick ones of every kind, whatever comes of them.

# %%
STORY = {"gantry": "single-021", "mixture": "mixture-004", "unnamed": "unnamed-004", "unseen": "unseen-002"}
OTHERS = ("empty-004", "empty-006", "empty-008", "single-007", "single-011", "single-018", "weak-003", "blunder-000")
specs = {spec.name: spec for spec in all_specs()}
cases = {name: replace(specs[case], name=name) for name, case in STORY.items()} | {n: specs[n] for n in OTHERS}
seals = {name: write(make(spec), work / "cases" / name, work / "sealed") for name, spec in cases.items()}
for name, seal in seals.items():
    print(f"{name:12}{seal}")

# %% [markdown]
# ## One machine
#
# A gantry with two drives: a carriage, a beam, a ram. Its engineer describes its joints by polynomials of degree two,
# and measures 477 poses, at eight levels of one axis. The plain fit predicts rows that were left out to 6 µm. Nothing
# in the files says whether that is good.


# %%
def recording(name: str) -> tuple[Machine, Survey]:
    """What the engineer has: a machine and a survey of it."""
    machine = read_machine(work / "cases" / name)
    return machine, read_survey(work / "cases" / name / "survey.csv", machine)


machine, survey = recording("gantry")
found = diagnose(machine, survey)
print(f"plain fit: {found.baseline.fitted.rms_um:.2f} um rms, held out {found.baseline.heldout.rms_um:.2f} um")
print(*diagnosis_lines(found.diagnosis), sep="\n")

# %% [markdown]
# Where: every cell is a motion of an element with a driver, and says how much of what is left over the best single
# effect there would explain.

# %%
groups = numbered(found)
draw_where_map(found.model, found.ranking, list(groups.items()))

# %% [markdown]
# Residuals along the driver, without the finding and with it. The geometry had taken most of the effect, which is why
# the residuals on the left are smaller than the effect itself, below.

# %%
evidence = evidence_of(found.model, groups[1])
residuals = draw_residuals_along_driver(evidence, found.final.sigma_mm)
residuals

# %%
draw_effect_curve(evidence, found.model, found.final)

# %% [markdown]
# What the missing effect had falsified: parameters of the geometry that the plain fit reported, and that are put
# right.

# %%
for parameter, change in found.diagnosis.findings[0].moved.items():
    print(f"{parameter:12}{change:12.3g}")

# %% [markdown]
# The machine as it is now, from the file that `diagnose` writes. It reads back and predicts the same.

# %%
for folder, fit in (("before", found.baseline), ("after", found.final)):
    store.save(fit, work / folder)
extended = (work / "after" / "machine.yaml").read_text()
print(extended[extended.index("effects:") :])

# %% [markdown]
# ### The truth is opened
#
# It holds the effect and, for 150 other poses, exact positions. `base` is the error there of a fit without the effect,
# `oracle` that of a fit that knows its true form, both by the simulator's own least squares.

# %%
truth = opened(work / "sealed" / "gantry.json", seals["gantry"])
(effect,) = truth["effects"]
commands = work / "cases" / "gantry" / "heldout.csv"
missed = {}
for folder in ("before", "after"):
    stored = store.load(work / folder)
    predicted = predict(stored, read_survey(commands, stored.chain.machine, measured=False))
    gap = predicted[["mx", "my", "mz"]].to_numpy() - np.array(truth["heldout"])
    missed[folder] = 1e3 * float(np.sqrt((gap**2).sum(axis=1).mean()))
size, hidden = effect["rms_um"], effect["absorbed"]
print(f"{effect['effect']} at {effect['where'][0]}, {size:.1f} um rms, of which geometry can absorb {hidden:.0%}")
print(f"at 150 other poses: {missed['before']:.2f} um before, {missed['after']:.2f} um after")
print(f"base {truth['base_heldout_um']:.2f} um, oracle {truth['oracle_heldout_um']:.2f} um")
assert found.diagnosis.findings[0].effect in effect["accept"]
assert missed["after"] < 0.5 * missed["before"]

# %% [markdown]
# ## Several at once, one without a name, none, and one that cannot be seen
#
# The tool runs on all twelve; each run sees the files of its own machine only. Then the seals are opened.

# %%
for name in cases:
    run_case(work / "cases" / name, work / "results")
scored = {}
for name, seal in seals.items():
    result = json.loads((work / "results" / f"{name}.json").read_text())
    scored[name] = Scored(opened(work / "sealed" / f"{name}.json", seal), result)


def told(name: str) -> None:
    """What the tool said of a machine, and what is true."""
    diagnosis, truth = scored[name].result["diagnosis"], scored[name].truth
    print(f"{name}: {diagnosis['verdict']}")
    for finding in diagnosis["findings"]:
        print(f"- {finding['statement']}")
    for finding in diagnosis["findings"]:
        print(f"  next: {finding['next_measurement']}")
    for effect in truth["effects"]:
        first, *others = effect["where"]
        print(f"truth: {effect['effect']} at {first}" + f" (in this survey like {', '.join(others)})" * bool(others))
    if truth["effects"]:
        s = scored[name]
        print(f"at 150 other poses: {s.rms('plain'):.2f} um before, {s.rms('final'):.2f} um after")
        print(f"base {truth['base_heldout_um']:.2f} um, oracle {truth['oracle_heldout_um']:.2f} um")


told("mixture")

# %% [markdown]
# In the next one, the motor's current moves a member by steps. No effect of the library does that. What is said:
# where, which motion, by what; and it is modelled all the same.

# %%
told("unnamed")

# %% [markdown]
# Nothing hidden: nothing said.

# %%
told("empty-006")
assert not scored["empty-006"].truth["effects"]

# %% [markdown]
# A target whose offset is wrong, but which is never changed: the measuring frame and the geometry take all of it.
# Nobody can see that in this survey. What can be said is that it cannot be seen, and what would show it.

# %%
told("unseen")
for item in scored["unseen"].result["diagnosis"]["untestable"]:
    if item["effect"] == "target-offset":
        print(f"cannot be seen: {item['effect']}: {item['reason']}. Needs: {item['needs']}")
assert scored["unseen"].said_untestable

# %% [markdown]
# `plan` says so before anything is measured: with one tool it is never seen, with a second one it is.

# %%
lines = list(plan_lines(plan(read_machine(work / "cases" / "unseen"), Setup(errormodel=1), 60, 0.002)))
print(*lines[:8], sep="\n")
print(*(line for line in "\n".join(lines).split("\n") if "target-offset" in line), sep="\n")

# %% [markdown]
# ## All twelve
#
# A dozen is a story and no proof. The whole is `python -m tests.proof`: 330 machines of ten kinds, 100 of them empty,
# ten to thirty minutes on two cores; `--quick` runs 40. It prints this table with its intervals, then all that went
# wrong.

# %%
for label, value in table(list(scored.values())):
    print(f"{label:<42}{value}")
print(*failures(list(scored.values())), sep="\n")
assert not any(s.broken or s.worse for s in scored.values())
assert not any(s.findings for s in scored.values() if s.kind == "empty")

# %% [markdown]
# ## Real: an axis that wanders while it warms up
#
# The Z axes of two 3-D printers, homed again and again against a fixed switch (tanaes/whopping_Voron_mods). The switch
# does not move; the position at which it closes does, by up to half a millimetre. Recordings are not part of the
# project: `ERRORMODEL_DATA` says where they are.

# %%
REAL = Path(os.environ.get("ERRORMODEL_DATA") or ROOT.parent / "shared" / "real")
printers, arm = REAL / "printer-frame", REAL / "ur10"
if not REAL.is_dir():
    print(f"no recordings at {REAL}: what follows is left out")


def brief(diagnosis: Diagnosis) -> None:
    """The findings, without the long list of what such a survey cannot show."""
    print(*takewhile(lambda line: "cannot be seen" not in line, diagnosis_lines(diagnosis)), sep="\n")


def homed(name: str) -> tuple[Machine, Survey]:
    machine = read_machine(printers)
    return machine, read_survey(printers / f"homing_{name}.csv", machine)


heated = {name: diagnose(*homed(name)) for name in "ab" if printers.is_dir()}
for name, result in heated.items():
    before, after = result.baseline.heldout.rms_um, result.final.heldout.rms_um
    print(f"homing_{name}, {result.final.folds} blocks, each left out in turn: {before:.1f} -> {after:.1f} um")
    brief(result.diagnosis)
    print(*(f"note: {note}" for note in result.diagnosis.notes), sep="\n")


# %%
def draw_homing() -> Figure:
    """The recorded wander and what is left of it, um over hours, both printers."""
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 2.6), facecolor="white")
    for k, (name, result) in enumerate(heated.items()):
        axes = style.panel(figure, 0.75 + 3.75 * k, 0.5, 3.1, 1.75)
        hours = result.final.survey.table["time"] / 3600
        for residual, colour, label in (
            (result.baseline.residuals, style.NOMINAL, "nothing explained"),
            (result.final.heldout_residuals, style.HELDOUT, "held out, with the finding"),
        ):
            axes.plot(hours, 1e3 * residual[:, 2], ".", ms=2, color=colour, label=label)
        style.dress(axes, "time / h", "z / µm" if not k else "", f"homing_{name}")
    axes.legend(fontsize=style.SMALL_TEXT, frameon=False, markerscale=4)
    return figure


draw_homing() if heated else None

# %% [markdown]
# ### What carries over to the other printer
#
# The model of `a` as it stands predicts `b`, where nothing but a constant is fitted. Then only its sensors and lags
# are taken over, and the sensitivities are fitted anew. The other way round cannot be tried: the model of `b` needs
# the temperature of the chamber, and that sensor of `a` is dead.

# %%
if heated:
    machine, survey = homed("b")
    store.save(heated["a"].final, work / "printer")
    wander = predict(store.load(work / "printer"), survey)["mz"]
    own = fit_machine(replace(machine, effects=heated["a"].final.chain.machine.effects), survey)
    print(f"b, nothing explained:          {heated['b'].baseline.heldout.rms_um:6.1f} um rms")
    print(f"b, by the model of a:          {1e3 * wander.std(ddof=0):6.1f} um rms")
    print(f"b, by a's sensors and lags:    {own.heldout.rms_um:6.1f} um rms held out")
    print(f"b, by its own finding:         {heated['b'].final.heldout.rms_um:6.1f} um rms held out")

# %% [markdown]
# ## Real: an arm
#
# A UR10 before a laser tracker (C. Landgraf et al., CASE 2021): series A walks a grid of 11 911 poses, series C has 2
# 773 random ones, measured on other days with the tracker elsewhere. The geometry, fitted, leaves half a millimetre.
# To keep this short, every tenth pose of C is diagnosed; `errormodel diagnose` on the whole takes minutes.


# %%
def moved(series: str, every: int) -> tuple[Machine, Survey]:
    """The arm, and each so-many-th row of a series."""
    machine = read_machine(arm)
    survey = read_survey(arm / f"series_{series}.csv", machine)
    return machine, replace(survey, table=survey.table.iloc[::every].reset_index(drop=True))


if arm.is_dir():
    turning = diagnose(*moved("c", 10))
    brief(turning.diagnosis)

# %% [markdown]
# What is left over is, for each of the first five joints, a curve of that joint's own angle: its drive. Gear, bearing
# or encoder, a target in the hand cannot tell. A curve that bends to anything could be noise that was fitted. If it
# is the arm's own, another series must show the same. Below are the curves of A and of C, each from a fit of its own,
# where both have poses. A constant, a slope and one wave a turn are taken off, which the geometry of each series has
# taken as it pleased.

# %%
CURVES = {"J1": "ec", "J2": "eb", "J3": "eb", "J4": "eb", "J5": "ec"}
SPACING, SIZE = np.radians(4.0), 5e-4  # rad
OVERLAP = np.radians(2.0)  # of an angle: where a series has rows that near


def with_curves(series: str, every: int) -> tuple[float, Fit]:
    """Held-out error (um) of the geometry alone, and the fit with the five curves."""
    machine, survey = moved(series, every)
    curves = [
        EffectSpec("higher-order-geometry", {"joint": joint, "motion": motion, "every": SPACING, "size": SIZE})
        for joint, motion in CURVES.items()
    ]
    return fit_machine(machine, survey).heldout.rms_um, fit_machine(replace(machine, effects=tuple(curves)), survey)


def curve(fit: Fit, joint: str, angle: Array) -> Array:
    """The curve of a joint (rad) at angles (rad), NaN where its series has fewer than three rows near."""
    machine, values = fit.chain.machine, fit.solution.named()
    spec = next(s for s in machine.effects if s.options["joint"] == joint)
    terms = make_effect(spec).terms(lambda name: angle, machine)
    motion = CURVES[joint]
    out = sum(values[f"{joint}.{motion}.higher-order-geometry-{t.label}"] * t.motion[motion] for t in terms)
    apart = fit.survey.table[joint].to_numpy()[:, None] - angle
    apart = np.abs(np.angle(np.exp(1j * apart)))  # a whole turn is the same place
    return np.where((apart < OVERLAP).sum(axis=0) >= 3, out, np.nan)


def slow(angle: Array) -> Array:
    """What geometry takes of a curve of an angle."""
    return np.column_stack([np.ones_like(angle), angle, np.cos(angle), np.sin(angle)])


if arm.is_dir():
    series = {"A": with_curves("a", 8), "C": with_curves("c", 2)}
    for name, (alone, fit) in series.items():
        print(f"series {name}, {len(fit.survey)} rows, held-out blocks: {alone:.0f} -> {fit.heldout.rms_um:.0f} um rms")
    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 2.6), facecolor="white")
    for joint in CURVES:
        angle = np.radians(np.arange(-180.0, 180.0))
        both = np.column_stack([curve(fit, joint, angle) for _, fit in series.values()])
        seen = np.isfinite(both).all(axis=1)
        if seen.sum() < 30:
            print(f"{joint}: no range in common")
            continue
        common = both[seen] - slow(angle[seen]) @ np.linalg.lstsq(slow(angle[seen]), both[seen], rcond=None)[0]
        agreement = np.corrcoef(common.T)[0, 1]
        print(f"{joint}: {seen.sum()} degrees in common, correlation {agreement:.2f}")
        k = len(figure.axes)
        axes = style.panel(figure, 0.65 + 2.55 * k, 0.5, 1.95, 1.45)
        for values, colour, name in zip(common.T, (style.FITTED, style.NOMINAL), series, strict=True):
            axes.plot(np.degrees(angle[seen]), 1e6 * values, ".", ms=2, color=colour, label=name)
        style.dress(axes, f"{joint} / °", "" if k else "µrad", f"{joint}: correlation {agreement:.2f}")
    figure.legend(*axes.get_legend_handles_labels(), fontsize=style.SMALL_TEXT, frameon=False, ncols=2, markerscale=4)
figure if arm.is_dir() else None

# %% [markdown]
# ## The example
#
# The files of the gantry are those of `machines/examples/gantry/`, with its truth.

# %%
EXAMPLE = ROOT / "machines" / "examples" / "gantry"
made = {file.name: file.read_bytes() for file in (work / "cases" / "gantry").iterdir()}
made["truth.json"] = (work / "sealed" / "gantry.json").read_bytes()
if "--write" in sys.argv:
    EXAMPLE.mkdir(exist_ok=True)
    for name, content in made.items():
        (EXAMPLE / name).write_bytes(content)
    style.save(residuals, ROOT / "notebooks" / "figures" / "gantry_residuals.png")
for name, content in made.items():
    assert (EXAMPLE / name).read_bytes() == content, f"{name} is not what the committed file holds; --write replaces it"
plt.close("all")
scratch.cleanup()
