"""What drives an effect, in words: channels, lags and times."""

from __future__ import annotations

from collections.abc import Sequence

from errormodel.channels import DERIVED_CHANNEL, root
from errormodel.effects.base import Effect
from errormodel.path_speed import joint_of_speed


def causes(effects: Sequence[Effect]) -> str:
    """What drives some effects together, in words: the lags of one sensor in a row."""
    lags: dict[str, list[float]] = {}
    plain = [set(e.drivers) for e in effects if not getattr(e, "tau", None)]
    for effect in effects:
        if any(set(effect.drivers) < other for other in plain):
            continue  # said with the others
        names = dict.fromkeys(effect.drivers)
        warm = [n for n in names if getattr(effect, "minus", None) and root(n).startswith("T_")]  # a difference of two
        runs = [n[4:-1] for n in names if n.startswith("run(")]
        said = [channel(n) for n in names if n not in warm and not n.startswith("run(")]
        said += [" less ".join(map(channel, warm))] if warm else []
        said += [f"run{'s' * (len(runs) > 1)} {', '.join(runs)}"] if runs else []
        moving = [joint for n in names if (joint := joint_of_speed(n))]
        if 1 < len(moving) == len(names):
            said = [f"the speeds of {', '.join(moving[:-1])}", moving[-1]]
        text = " and ".join(said) or "position"
        lags.setdefault(text, []).append(getattr(effect, "tau", None) or 0.0)
    initial = "".join(map(_initial, effects))
    return " and ".join(f"{text}{_behind(text, taus)}" for text, taus in lags.items()) + initial


def _initial(effect: Effect) -> str:
    """How far a member was from its sensor's temperature in the first row."""
    excess, sensor = float(getattr(effect, "initial", 0.0)), str(getattr(effect, "sensor", ""))
    warm = f", {abs(excess):.2g} K {'warmer' if excess > 0 else 'colder'} than {sensor} in the first row"
    before = f", as if that had been {abs(excess):.4g} {'more' if excess > 0 else 'less'} before the first row"
    return "" if not excess else warm if sensor.startswith("T_") else before


def _behind(text: str, taus: Sequence[float]) -> str:
    if not (late := [duration(tau) for tau in dict.fromkeys(taus) if tau]):
        return ""
    many = "s" * (len(late) > 1)
    if text == "time":
        return f", settling with time constant{many} of {' and '.join(late)}"
    return f"{', at once and' if 0.0 in taus else ''} behind {'' if many else 'a '}lag{many} of {' and '.join(late)}"


def channel(name: str) -> str:
    """A channel in words."""
    if call := DERIVED_CHANNEL.fullmatch(name):
        behind = f" behind a lag of {duration(float(call[3]))}" if name.startswith("lag") else ", with play"
        return call[2] + behind
    if moving := joint_of_speed(name):
        return f"the speed of {moving}"
    if name == "row":
        return "the order of the rows"
    if name.startswith("dir_"):
        return f"the side from which {name[4:]} arrives"
    return f"run {name[4:-1]}" if name.startswith("run(") else name


def duration(seconds: float) -> str:
    """A time as one says it."""
    size, unit = time_unit(seconds)
    return f"{seconds / size:.3g} {unit}"


def time_unit(seconds: float) -> tuple[float, str]:
    """Size, s, and name of the unit in which one says a time."""
    return next(((s, u) for s, u in ((3600.0, "h"), (60.0, "min")) if seconds >= 1.5 * s), (1.0, "s"))
