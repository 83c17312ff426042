"""Scores of what the tool said, against truths opened from their seals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from tests.proof.kinematics import Array

Z95 = 1.96
Finding = dict[str, Any]


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % interval of a share."""
    if not n:
        return 0.0, 1.0
    p, z2 = hits / n, Z95**2
    centre, half = p + z2 / (2 * n), Z95 * sqrt(p * (1 - p) / n + z2 / (4 * n**2))
    return max(0.0, (centre - half) / (1 + z2 / n)), min(1.0, (centre + half) / (1 + z2 / n))


def says(finding: Finding, effect: dict[str, Any]) -> bool:
    """Whether a finding names an effect; or what cannot be told from it there, the effect among the alternatives."""
    if finding["effect"] in effect.get("undecided", {}):
        return any(a["effect"] in effect["accept"] for a in finding["alternatives"])
    return finding["effect"] in effect["accept"]


def at(finding: Finding, effect: dict[str, Any]) -> bool:
    """Whether a finding is where an effect is, or where it is under the name that the survey allows as well."""
    return finding["where"] in effect.get("undecided", {}).get(finding["effect"], effect["where"])


@dataclass(frozen=True)
class Scored:
    """One case: counts of effects and findings, errors at later poses, and what each finding was worth."""

    truth: dict[str, Any]
    result: dict[str, Any]
    seconds: float = 0.0

    @property
    def broken(self) -> bool:
        return "error" in self.result

    @property
    def kind(self) -> str:
        return str(self.truth["kind"])

    @property
    def findings(self) -> list[Finding]:
        """All that it says, but for wild rows where the noise has heavy tails: some of these rows are wild."""
        if self.broken:
            return []
        return [f for f in self.result["diagnosis"]["findings"] if f["effect"] not in self.truth["tolerate"]]

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The effects that are there to be found."""
        return [] if self.kind == "unseen" else list(self.truth["effects"])

    def named(self, effect: dict[str, Any]) -> bool:
        return any(says(f, effect) for f in self.findings)

    def placed(self, effect: dict[str, Any]) -> bool:
        return any(says(f, effect) and at(f, effect) for f in self.findings)

    def outright(self, effect: dict[str, Any]) -> bool:
        """Named without help from its alternatives."""
        return any(f["effect"] in effect["accept"] for f in self.findings)

    def located(self, effect: dict[str, Any]) -> bool:
        """Something was found in the right place, whatever its name."""
        return any(f["where"] in effect["where"] or at(f, effect) for f in self.findings)

    def right(self, finding: Finding) -> bool:
        return any(says(finding, e) for e in self.effects)

    @property
    def false(self) -> list[Finding]:
        """Findings that the recording does not hold; one unnamed for each effect that was missed is none."""
        wrong = [f for f in self.findings if not self.right(f)]
        missed = sum(not self.named(e) for e in self.effects)
        spared = [f for f in wrong if f["effect"] == "unnamed"][:missed]
        return [f for f in wrong if not any(f is s for s in spared)]

    @property
    def false_names(self) -> list[Finding]:
        return [f for f in self.findings if not self.right(f) and f["effect"] != "unnamed"]

    @property
    def said_untestable(self) -> bool:
        said = set() if self.broken else {u["effect"] for u in self.result["diagnosis"]["untestable"]}
        return all(e["effect"] in said for e in self.truth["effects"])

    def rms(self, which: str) -> float:
        """3-D error (um) of the `final` or `plain` fit at the later poses."""
        gap = self.gaps(which)
        return float(1e3 * np.sqrt(np.mean(np.sum(gap**2, axis=1))))

    def gaps(self, which: str) -> Array:
        out: Array = np.array(self.result[which])[:, :3] - np.array(self.truth["heldout"])
        return out

    @property
    def inside(self) -> Array:
        """Which coordinates of the later poses lie within two standard uncertainties, (n, 3)."""
        out: Array = np.abs(self.gaps("final")) < 2 * np.array(self.result["final"])[:, 3:]
        return out

    @property
    def excess(self) -> float | None:
        """Error beyond that of a fit that knows the true form, as a share of what there was to gain."""
        base, oracle = self.truth["base_heldout_um"], self.truth["oracle_heldout_um"]
        large = self.kind in ("single", "mixture", "pair", "unnamed") and any(map(_large, self.effects))
        if self.broken or not large or base < 1.15 * oracle:
            return None
        return float((self.rms("final") - oracle) / (base - oracle))

    @property
    def worse(self) -> bool:
        """Whether predictions became worse than a plain fit's, by more than a tenth of the noise or 2 %."""
        if self.broken:
            return True
        return self.rms("final") > 1.02 * self.rms("plain") + 50 * float(self.truth["sigma_mm"])

    @property
    def value_inside(self) -> list[bool]:
        """Of findings whose parameter compares with the truth: whether it is within two standard deviations."""
        out = []
        for e in self.effects:
            for f in self.findings:
                if e.get("value") is not None and f["effect"] == e["effect"] and len(f["parameters"]) == 1:
                    p = f["parameters"][0]
                    out.append(abs(p["value"] - e["value"]) < 2 * p["std"])
        return out


def share(hits: int, n: int) -> str:
    """A share with its interval."""
    if not n:
        return "-"
    low, high = wilson(hits, n)
    return f"{hits}/{n} = {100 * hits / n:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def calibration(scored: Iterable[Scored], bins: int = 10) -> tuple[float, float, float, int]:
    """Expected calibration error, what so many findings show of it by chance if all is right, Brier score, number."""
    said, were = [], []
    for s in scored:
        for f in s.findings:
            if f["effect"] not in ("outliers", "axis-blunder", "unnamed"):
                said.append(float(f["probability"]))
                were.append(float(s.right(f)))
    if not said:
        return 0.0, 0.0, 0.0, 0
    p, y = np.array(said), np.array(were)
    place = np.minimum((p * bins).astype(int), bins - 1)

    def error(right: Array) -> float:
        return sum(abs(float((p - right)[place == b].sum())) for b in np.unique(place)) / len(p)

    rng = np.random.default_rng(0)
    chance = np.mean([error((rng.random(len(p)) < p).astype(float)) for _ in range(200)])
    return error(y), float(chance), float(np.mean((p - y) ** 2)), len(said)


def told_apart(scored: Sequence[Scored]) -> list[tuple[Scored, dict[str, Any]]]:
    """Effects that are large enough to be told apart, also from the others of their recording."""
    return [(s, e) for s in scored if s.kind in ("single", "mixture", "pair") for e in s.effects if _large(e)]


def _large(effect: dict[str, Any]) -> bool:
    return bool(min(effect["delta"], effect.get("delta_joint", 1e9)) >= 12)


def table(scored: Sequence[Scored]) -> list[tuple[str, str]]:
    """The lines of the table."""
    empty = [s for s in scored if s.kind == "empty"]
    large = told_apart(scored)
    unnamed = [s for s in scored if s.kind == "unnamed"]
    unseen = [s for s in scored if s.kind == "unseen"]
    weak = [s for s in scored if s.kind == "weak"]
    blunders = [(s, e) for s in scored if s.kind == "blunder" for e in s.effects]
    sound = [s for s in scored if not s.broken and s.kind != "blunder"]
    excess = np.array([x for s in scored if (x := s.excess) is not None])
    inside = np.concatenate([s.inside.ravel() for s in sound]) if sound else np.zeros(0)
    values = [v for s in sound for v in s.value_inside]
    ece, chance, brier, count = calibration(scored)
    seconds = [s.seconds for s in scored]
    spurious = sum(len(s.false) for s in scored)
    return [
        ("false alarms on empty data", share(sum(bool(s.findings) for s in empty), len(empty))),
        ("named, where it can be told apart", share(sum(s.named(e) for s, e in large), len(large))),
        ("of these outright, not as an alternative", share(sum(s.outright(e) for s, e in large), len(large))),
        ("named and placed", share(sum(s.placed(e) for s, e in large), len(large))),
        ("something found in the right place", share(sum(s.located(e) for s, e in large), len(large))),
        ("false findings a case", f"{spurious / max(len(scored), 1):.3f} ({spurious} in {len(scored)})"),
        ("cases with a false name", share(sum(bool(s.false_names) for s in scored), len(scored))),
        ("false names on effects without a name", share(sum(bool(s.false_names) for s in unnamed), len(unnamed))),
        ("found, without a name", share(sum(any(map(s.right, s.findings)) for s in unnamed), len(unnamed))),
        ("false names on weak effects", share(sum(bool(s.false_names) for s in weak), len(weak))),
        ("cannot be seen: said so", share(sum(s.said_untestable for s in unseen), len(unseen))),
        ("cannot be seen: no finding", share(sum(not s.findings for s in unseen), len(unseen))),
        ("blunders and outliers named", share(sum(s.named(e) for s, e in blunders), len(blunders))),
        ("excess over the oracle, median; 90 %", _quantiles(excess)),
        ("worse than a plain fit", share(sum(s.worse for s in sound), len(sound))),
        ("coverage of 2 sigma, predictions", f"{100 * inside.mean():.1f} % of {inside.size}" if inside.size else "-"),
        ("coverage of 2 sigma, parameters", share(sum(values), len(values))),
        (
            "calibration of probability",
            f"ECE {ece:.3f} (by chance {chance:.3f}), Brier {brier:.3f} of {count} findings",
        ),
        ("seconds a case, median; most", f"{np.median(seconds):.1f}; {max(seconds):.1f}" if seconds else "-"),
        ("broken", share(sum(s.broken for s in scored), len(scored))),
    ]


def _quantiles(values: Array) -> str:
    if not len(values):
        return "-"
    return f"{np.median(values):.3f}; {np.quantile(values, 0.9):.3f} of {len(values)}"


def by(scored: Sequence[Scored], key: str) -> list[str]:
    """One line a value of a key of the truth."""
    head = f"{key:<24}{'cases':>6}{'alarms':>8}{'named':>10}{'placed':>10}{'false':>7}{'excess':>8}{'cover':>7}"
    values = sorted({str(s.truth[key]) for s in scored})
    return [head, *(f"{v:<24}" + _line([s for s in scored if str(s.truth[key]) == v]) for v in values)]


def _line(scored: list[Scored]) -> str:
    empty = [s for s in scored if s.kind == "empty"]
    pairs = [(s, e) for s in scored if s.kind != "weak" for e in s.effects]
    excess = [x for s in scored if (x := s.excess) is not None]
    sound = [s for s in scored if not s.broken and s.kind != "blunder"]
    cover = np.mean([s.inside.mean() for s in sound]) if sound else np.nan
    alarms = f"{sum(bool(s.findings) for s in empty)}/{len(empty)}"
    named, placed = (f"{sum(f(s, e) for s, e in pairs)}/{len(pairs)}" for f in (Scored.named, Scored.placed))
    middle = f"{np.median(excess):.2f}" if excess else "-"
    false = sum(len(s.false) for s in scored)
    return f"{len(scored):>6}{alarms:>8}{named:>10}{placed:>10}{false:>7}{middle:>8}{100 * cover:>7.1f}"


def failures(scored: Sequence[Scored]) -> list[str]:
    """One line a case in which anything went wrong."""
    lines = []
    for s in scored:
        faults = []
        if s.broken:
            faults.append("broken: " + s.result["error"].strip().splitlines()[-1])
        else:
            large = [e for e in s.effects if s.kind not in ("weak", "unnamed") and _large(e)]
            faults += [f"not named: {e['effect']}" for e in large if not s.named(e)]
            faults += [f"not placed: {e['effect']}" for e in large if s.named(e) and not s.placed(e)]
            faults += [f"false: {f['effect']} at {f['where']} ({f['probability']:.2f})" for f in s.false]
            if s.worse:
                faults.append(f"worse than plain: {s.rms('final'):.2f} over {s.rms('plain'):.2f}")
            if (x := s.excess) is not None and x > 0.3:
                faults.append(f"excess {x:.2f}")
        if faults:
            said = [(f["effect"], f["where"], "".join(f["driver"][:2])) for f in s.findings]
            meant = [(e["effect"], e["where"][:3], round(e["delta"], 1)) for e in s.truth["effects"]]
            where = f"{s.truth['topology']}/{s.truth['plan']}/{s.truth['noise']}/n={s.truth['n']}"
            lines.append(f"{s.truth['case']} [{where}] {'; '.join(faults)} | truth {meant} | said {said}")
    return lines
