"""Plans of poses that are read by lengths: their information, uncertainty, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.planning.candidates import prepare
from identification.planning.plan import plan
from identification.planning.poses import as_survey
from identification.planning.setup import Setup

MACHINE = read_machine("vertical_three_axis")
PLAIN = Setup(errormodel=1)
PLACES = {"A": [900, -700, -200], "B": [-900, -600, 0], "C": [0, 900, 100], "D": [200, -200, 900]}
NOISE = 5e-4  # mm


def by_lengths(count: int) -> Setup:
    """Distances from stations of which only the rough place is known."""
    entries = {k: {"type": "station-distance", "near": PLACES[k]} for k in [*PLACES][:count]}
    return Setup.model_validate({"errormodel": 1, "observations": entries})


@pytest.mark.long
def test_lengths_from_stations_are_planned_by_their_own_information() -> None:
    """The covariance that poses are chosen by is that of a fit to lengths there, and counts within the machine."""
    setup = by_lengths(4)
    planned = plan(MACHINE, setup, 40, NOISE, seed=1)
    set_up = sum(n.startswith("observation[") for n in np.array(planned.groups.ids)[planned.groups.base])
    assert planned.groups.rank - set_up == 24  # as a tracker shows
    assert planned.blind == 0  # where the whole machine is, nobody asks
    assert planned.uncertainty.worst_um < planned.random.worst_um
    assert planned.d_random > 1.2
    stage = prepare(MACHINE, setup, NOISE, 1)
    assert stage.space.components == 4
    survey = as_survey(stage.chain, setup, planned.table, NOISE)
    assert len(survey) == 4 * 40
    joints = [j.name for j in MACHINE.joints]
    rows = planned.table[joints].to_numpy()
    chosen = np.array([int(np.flatnonzero((stage.positions == row).all(axis=1))[0]) for row in rows])
    every = as_survey(stage.chain, setup, stage.table, NOISE)
    own, all_of_them = (np.linalg.slogdet(fit_machine(MACHINE, s).solution.covariance)[1] for s in (survey, every))
    # in the plan's basis all candidates together have the information one; the fit starts from rough stations as well
    assert own - all_of_them == pytest.approx(np.linalg.slogdet(stage.space.covariance(chosen))[1], abs=0.05)


@pytest.mark.long
def test_coordinates_and_a_length_are_planned_together() -> None:
    """A fine length beside coarse coordinates: surer, and each noise counts for its own rows."""
    coarse = plan(MACHINE, PLAIN, 30, 5e-3, seed=2)
    fine = {"A": {"type": "station-distance", "near": PLACES["A"], "sigma": [2e-4, 0.0]}}
    both = plan(
        MACHINE, Setup.model_validate({"errormodel": 1, "observations": fine, "coordinates": True}), 30, 5e-3, seed=2
    )
    assert both.uncertainty.median_um < 0.9 * coarse.uncertainty.median_um


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"type": "ballbar-circle", "calibrated": 150.0}, "and not any one"),
        ({"type": "pose-distance"}, "and not any one"),
        ({"type": "precision-level", "axis": [1, 0, 0]}, "no standard uncertainty"),
        ({"type": "station-distance"}, "a station of which nothing is known"),
    ],
)
def test_observations_that_cannot_be_planned_are_refused(entry: dict[str, object], says: str) -> None:
    setup = Setup.model_validate({"errormodel": 1, "observations": {"A": entry}})
    with pytest.raises(InputError, match=says):
        plan(MACHINE, setup, 30, 1e-3)
