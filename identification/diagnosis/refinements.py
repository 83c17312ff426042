"""Further forms of an effect that was found: the same motion by the same cause, but not as the textbook bends it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.effects.base import Effect
from errormodel.effects.unnamed import Unnamed
from errormodel.features import root
from identification.diagnosis.workbench import Workbench

FORMS = ("linear", "square", "cubic")


def forms(bench: Workbench, effect: Effect) -> Iterator[Effect]:
    """Generic terms at the effect's place by its drivers (lagged too, where it is warmth), along its joint's travel."""
    machine = bench.chain.machine
    joint = next((j for j in bench.scene.moving if j.name == effect.where), None)
    moves = {(t.element, m) for t in effect.terms(bench.channel, machine) for m in t.motion}
    for element, motion in sorted(moves):
        for driver in _drivers(bench, effect):
            center, half = _range(bench, driver)
            if half <= 0 or not np.isfinite(half):
                continue
            common = {"element": element, "motion": motion, "driver": driver, "center": center, "half_range": half}
            for form in FORMS[: 1 if driver.startswith("dir_") else 3]:
                yield Unnamed.model_validate({**common, "form": form})
            if joint is not None and driver != joint.name:
                by_center, by_half = _range(bench, joint.name)
                for form in FORMS:
                    by = {"by": joint.name, "by_form": form, "by_center": by_center, "by_half_range": by_half}
                    yield Unnamed.model_validate({**common, **by})


def _drivers(bench: Workbench, effect: Effect) -> list[str]:
    names = list(dict.fromkeys(map(root, effect.drivers)))
    if any(n.startswith("T_") or n == "time" for n in names):
        warm = [n for n in names if n.startswith("T_")] or list(bench.scene.sensors)
        span = bench.scene.duration
        names = [*names, *warm, *(["time"] if span else [])]
        names += [f"lag({n},{span / part:.4g})" for n in warm if span for part in (32, 12, 5)]
    return list(dict.fromkeys(names))


def _range(bench: Workbench, name: str) -> tuple[float, float]:
    """Middle and half range of a channel as the survey has it, to four digits: they go into the model's file."""
    values = bench.channel(name)
    low, high = float(values.min()), float(values.max())
    return float(f"{(low + high) / 2:.4g}"), float(f"{(high - low) / 2:.4g}")
