"""What is advised: to adjust (not what a rotary axis does, nor what is no larger than its uncertainty), and to use."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from identification.compensation.advice import Advice, mechanical_advice
from identification.compensation.field import Field
from identification.compensation.kinematic_description import Kinematics
from identification.compensation.result import Compensation
from identification.compensation.rows import read_rows
from identification.compensation.volume import Volume
from identification.estimation.fit import fit_machine
from identification.results.store import load, save
from tests.helpers.commands import MILL
from tests.helpers.compensation import UM, volume_of
from tests.helpers.surveys import measured, positions, survey


@pytest.mark.parametrize(("name", "what"), [("T1.ec", []), ("T2.ec", ["squareness of Y against X"])])
def test_a_rotary_axis_that_lies_askew_is_no_twisted_bed(name: str, what: list[str]) -> None:
    """Over the positions of a table B a squareness turns with it: a twist of -103 urad was to be levelled away."""
    machine = read_machine("five_axis_table_quill")
    found = mechanical_advice(volume_of(machine, Chain(machine).vector({name: 80e-6})), 20.0)
    assert [a.what.split(" (")[0] for a in found] == what


def test_only_what_clearly_exceeds_its_uncertainty_is_advised(tmp_path: Path) -> None:
    """The same squareness, measured well and badly: its uncertainty covers it, and grows with the noise."""
    machine = read_machine(MILL)
    p = Chain(machine).vector({"saddle.ec": 80e-6})

    def advised(noise: float) -> list[Advice]:
        save(fit_machine(machine, survey(positions(measured(machine, p, 60, 1, noise=noise)))), tmp_path / f"{noise}")
        fit = load(tmp_path / f"{noise}")
        table = read_rows(tmp_path / f"{noise}", fit.chain.machine)
        return mechanical_advice(Volume.of(Field.of(fit, table), table, True), 20.0, fit)

    (well,) = advised(2 * UM)
    assert "Y against X" in well.what
    assert abs(abs(well.angle) - 80e-6) < 3 * well.std
    assert 0.5e-6 < well.std < 5e-6
    assert f" +- {1e6 * well.std:.2g} urad" in well.line()
    assert advised(200 * UM) == []


def test_where_rotary_axes_lie_comes_before_richer_formats() -> None:
    """Where that alone leaves less than the tables do, and was not asked for."""
    machine = read_machine(MILL)
    setup, usual = (
        volume_of(machine, Chain(machine).vector({})).setup(None, None)[0],
        SimpleNamespace(conditions=SimpleNamespace(left_um=30.0)),
    )
    said = {}
    for left_um, asked in ((9.0, False), (35.0, False), (9.0, True)):
        whole = SimpleNamespace(rotary=Kinematics((), 100.0, left_um, asked), setup=setup, usual=usual)
        said[left_um, asked] = Compensation._more(whole, target("siemens-lec"))  # type: ignore[arg-type]
    assert said[9.0, False] == "--kinematics (it alone leaves 9.0 um) or --controller siemens-cec or csv or gcode"
    assert said[35.0, False] == said[9.0, True] == "--controller siemens-cec or csv or gcode"


def test_a_control_is_found_by_a_word_of_its_title() -> None:
    with pytest.raises(InputError, match=r"Did you mean 'siemens-cec' or 'siemens-lec'[?] Valid: aerotech"):
        target("sinumerik")
    with pytest.raises(InputError, match=r"Did you mean 'fanuc-3d'[?] Valid: "):
        target("fanuc3d")
