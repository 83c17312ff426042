"""A rotary joint that was measured at two places: how frame and table share what is seen there is not known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.chain import Chain
from errormodel.instruments.plain import Plain
from errormodel.simulation import measured_at, random_points
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.estimation.fit import fit_machine
from identification.results.predictions import predicted
from identification.results.store import load, save
from tests.helpers.diagnosed import FRAME, SIZES
from tests.helpers.effect_battery import FIVE_AXIS

READ = ["mx", "my", "mz"]
TWO = (0.0, np.pi / 2)


def rows(seed: int, errors: dict[str, float], noise: float, turns: tuple[float, ...] = ()) -> Survey:
    """Positions anywhere, of the table anywhere or at some places."""
    table = random_points(FIVE_AXIS, 150, seed)
    if turns:
        table["B"] = np.random.default_rng(seed).choice(turns, len(table))
    table = table.assign(run="1", file="a.csv", role="fit", row=np.arange(1, len(table) + 1))
    seen = measured_at(FIVE_AXIS, table, Truth(errors, *FRAME), noise, seed)
    return Survey(pd.concat([table, seen[READ]], axis=1), "shared", ("frame",), Plain(type="plain"), Path("a.csv"))


def test_what_two_places_do_not_tell(tmp_path: Path) -> None:
    """Errors before and after the joint are alike there and part elsewhere: the uncertainty has their usual size."""
    rng, chain = np.random.default_rng(5), Chain(FIVE_AXIS)
    errors = {p.id: rng.normal(0, SIZES[p.unit]) for p in chain.parameters if p.id in chain.machine_ids}
    save(fit_machine(FIVE_AXIS, rows(1, errors, 0.002, TWO)), tmp_path)
    known = load(tmp_path)
    stated, share = [], []
    for turns in (TWO, ()):
        points = rows(2, errors, 0.0, turns)
        table = predicted(known, points)
        wrong = np.abs(table[READ].to_numpy() - points.table[READ].to_numpy())
        u = table[["ux", "uy", "uz"]].to_numpy()
        stated.append(1e3 * float(np.sqrt(np.mean(u**2))))
        share.append(float(np.mean(wrong < 2 * u)))
    assert stated[0] < 2  # um, where it was measured
    assert stated[1] > 10
    assert min(share) > 0.85
