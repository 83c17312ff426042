"""Temperature sensors that are dead, and such as only look so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.instruments.plain import Plain
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from errormodel.surveys.temperatures import fahrenheit_notes
from identification.diagnosis.data_checks.temperature_sensors import dead_sensors


def thermal(**sensors: object) -> Survey:
    n = 200
    table = pd.DataFrame({"role": "fit", "time": 10.0 * np.arange(n), **sensors})
    return Survey(table, "shared", ("frame",), Plain(type="plain"), Path("a.csv"))


def test_dead_sensors() -> None:
    t = np.arange(200)
    warming = 20 + 5 * (1 - np.exp(-t / 60))
    stuck = np.where(t < 60, 20 + 0.1 * t, 26.0)
    loose = warming + np.where(t % 50 == 20, 60.0, 0.0)
    gap = np.where(t == 3, np.nan, warming)
    said = dead_sensors(
        thermal(
            T_bed=warming,
            T_chamber=-180.0,
            T_frame=stuck,
            T_loose=loose,
            T_gap=gap,
            T_room=np.where(t < 150, warming, 1.8 * warming + 32),
            T_hotend=8 * warming,
            T_oven=8 * warming,
        )
    )
    assert said == {
        "T_chamber": "-180 degC in all rows",
        "T_frame": "stuck at 26 degC in 140 of 200 rows while others move by 61.5 K",
        "T_loose": "jumps by more than 10 K and back in 4 of 200 rows",
        "T_gap": "no value in 1 of 200 rows",
        "T_room": "goes from 24.58 to 76.26 at row 151, as from degC to degF",
        "T_oven": "160 to 198.5 degC in all rows",
    }


def test_a_copy_of_a_sensor_drives_nothing() -> None:
    """Gaps are copied as well; sensors that never change may be alike."""
    rng, t = np.random.default_rng(1), np.arange(200)
    one = np.round(20 + 0.02 * t + rng.normal(0, 0.05, 200), 2)
    noisy = np.round(one + rng.normal(0, 0.05, 200), 2)
    still = np.full(200, 20.0)
    said = dead_sensors(thermal(T_1=one, T_2=one.copy(), T_3=noisy))
    assert said == {"T_2": "the same as T_1 in all 200 rows, a copy"}
    assert dead_sensors(thermal(T_4=still, T_5=still)) == {}


def test_degrees_fahrenheit_beside_celsius_are_asked_about() -> None:
    t = np.arange(100)
    bed, air = 18.5 + 0.01 * t, np.full(100, 18.6)
    (note,) = fahrenheit_notes(pd.DataFrame({"T_bed": 1.8 * bed + 32, "T_air": air, "T_room": air + 0.5}))
    assert note.startswith("T_bed is 65.3 to 67.08 degC where T_air is 18.6 to 18.6")
    assert "units: {T_bed: degF}" in note
    assert "--units T_bed=degF" in note
    warming = pd.DataFrame({"T_spindle": 1.8 * (20 + 12 * t / 100) + 32, "T_room": 20 + 0.01 * t})
    assert "as degF it would be 20 to 31.9 degC" in "".join(fahrenheit_notes(warming))
    spindle = 20 + 46 * (1 - np.exp(-t / 10))  # it begins where the room is
    alone, near = pd.DataFrame({"T_bed": 1.8 * bed + 32}), pd.DataFrame({"T_oil": 32 + 0 * bed, "T_air": air})
    for table in (pd.DataFrame({"T_spindle": spindle, "T_air": air}), alone, near):
        assert not list(fahrenheit_notes(table))


def test_quick_sensors_are_alive() -> None:
    """A nozzle that heats in a minute, a motor that cycles, a thermostat that holds, a room that is kept."""
    t = np.arange(200)
    nozzle = 24 + 76 * (1 - np.exp(-t / 4))
    motor = 30 + 8 * np.sign(np.sin(t / 9))
    thermostat = np.round(24 + 81 * (1 - np.exp(-t / 10)), 1)
    assert (
        dead_sensors(thermal(T_nozzle=nozzle, T_motor=motor, T_bed=thermostat, T_room=20.0 + 0 * t + 0.01 * (t % 2)))
        == {}
    )


def test_the_printer_has_a_dead_sensor(real_data: Path) -> None:
    from errormodel.survey import read_survey

    machine = read_machine(real_data / "printer-frame" / "machine.yaml")
    files = {n: read_survey(real_data / "printer-frame" / f"{n}.csv", machine) for n in ("homing_a", "homing_b")}
    assert dead_sensors(files["homing_a"]) == {"T_chamber": "-180 degC in all rows"}
    assert dead_sensors(files["homing_b"]) == {}
