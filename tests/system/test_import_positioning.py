"""Positioning tests as laboratories write them: runs side by side, the other way round, nominal and actual."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey
from errormodel.machine import Joint, Machine
from errormodel.raw_formats.base import format_of, open_raw
from identification import import_survey, iso
from tests.helpers.commands import done, run
from tests.helpers.importing import MILL
from tests.helpers.nightly import first_of

MACHINE = read_machine(MILL)
TARGETS = np.arange(-150.0, 151.0, 50.0)
RUNS = 5
UM = np.random.default_rng(4).normal(0, 2.0, (len(TARGETS), RUNS, 2)).round(1) + np.array([0.0, 8.0])  # there and back
HEADS = {
    "arrows": ("Position [mm]", lambda k, back: f"{k}{'↓' if back else '↑'} [µm]"),
    "signs": ("Target (mm)", lambda k, back: f"Run {k} {'-' if back else '+'} (um)"),
    "letters": ("Pos", lambda k, back: f"{'B' if back else 'F'}{k} [um]"),
    "words": ("X soll [mm]", lambda k, back: f"{'zurück' if back else 'vor'} {k} [µm]"),
    "names that come again": ("Sollposition [mm]", lambda k, back: "rück [µm]" if back else "hin [µm]"),
    "underscores": ("target_mm", lambda k, back: f"run{k}_{'bwd' if back else 'fwd'}_um"),
}


def table(style: str, positions: bool = False) -> pd.DataFrame:
    """A row a target, a column a run of a direction."""
    target, name = HEADS[style]
    columns = [(name(k + 1, back), UM[:, k, back]) for k in range(RUNS) for back in (0, 1)]
    values = [TARGETS + v / 1e3 if positions else v for _, v in columns]
    return pd.DataFrame(np.column_stack([TARGETS, *values]), columns=[target, *(n for n, _ in columns)])


def check(survey_table: pd.DataFrame) -> None:
    """All readings at their targets, in their runs and directions."""
    assert len(survey_table) == UM.size
    for back, side in ((0, 1.0), (1, -1.0)):
        own = survey_table[survey_table["dir_X"] == side]
        found = own.assign(run=own["run"].astype(int)).pivot(index="X", columns="run", values="dx")
        np.testing.assert_allclose(found.to_numpy() * 1e3, UM[:, :, back], atol=1e-6)
        np.testing.assert_allclose(found.index, TARGETS, rtol=1e-12)  # rounding of inches


@pytest.mark.parametrize("style", HEADS)
@pytest.mark.parametrize("comma", first_of([True, False]))
def test_runs_side_by_side(style: str, comma: bool, tmp_path: Path) -> None:
    text = table(style).to_csv(index=False, sep=";", decimal="," if comma else ".", float_format="%.4f")
    (tmp_path / "x.csv").write_bytes(text.encode("utf-16" if comma else "utf-8"))
    check(import_survey(tmp_path / "x.csv", MILL, joint="X").survey.table)


def test_two_rows_of_names_and_a_unit_above(tmp_path: Path) -> None:
    head = "Positionierabweichung in µm\n;" + ";".join(f"Lauf {k + 1};" for k in range(RUNS))
    head += "\nPosition;" + ";".join(["vor;zurück"] * RUNS) + "\n"
    rows = table("letters").to_csv(index=False, header=False, sep=";", decimal=",", float_format="%.4f")
    (tmp_path / "x.csv").write_bytes((head + rows).encode("cp1252"))
    check(import_survey(tmp_path / "x.csv", MILL, joint="X").survey.table)


@pytest.mark.parametrize("labels", ["one", "two"])
def test_a_row_a_run(labels: str, tmp_path: Path) -> None:
    """As spreadsheets of laser software have it: targets along the first row; means below are passed over."""
    turned = [["Deviation [um]"], ["Target" if labels == "one" else "Run;Direction", *TARGETS]]
    for k in range(RUNS):
        for back in (0, 1):
            sign = "-" if back else "+"
            turned.append([f"Run {k + 1} {sign}" if labels == "one" else f"{k + 1};{sign}", *UM[:, k, back]])
    turned.append(["Mean +" if labels == "one" else "Mean;+", *UM[:, :, 0].mean(axis=1).round(3)])
    (tmp_path / "x.csv").write_text("\n".join(";".join(map(str, row)) for row in turned) + "\n")
    check(import_survey(tmp_path / "x.csv", MILL, joint="X").survey.table)


def test_positions_instead_of_deviations_and_a_reading_that_is_missing(tmp_path: Path) -> None:
    data = table("signs", positions=True)
    data.columns = [c.replace(" (um)", "") for c in data]
    data.to_csv(tmp_path / "x.csv", index=False)
    result = import_survey(tmp_path / "x.csv", MILL, joint="X")
    check(result.survey.table)
    assert "measured positions of X" in result.summary()
    data.iloc[2, 3] = np.nan
    data.to_csv(tmp_path / "y.csv", index=False)
    result = import_survey(tmp_path / "y.csv", MILL, joint="X")
    assert len(result.survey.table) == UM.size - 1
    assert "1 readings missing" in result.summary()


def test_what_is_ambiguous_is_asked_and_answered(tmp_path: Path) -> None:
    data = table("arrows")
    bare = data.set_axis(["Position", *(f"Run {k}" for k in range(1, 2 * RUNS + 1))], axis=1)
    bare.to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(InputError, match=r"does not say the direction: Run 1, Run 2.*--columns 1\+=Run 1,1-=Run 2"):
        import_survey(tmp_path / "x.csv", MILL, joint="X")
    said = {f"{k + 1}{s}": f"Run {2 * k + 1 + back}" for k in range(RUNS) for back, s in enumerate("+-")}
    with pytest.raises(InputError, match=r"no unit of the deviations.*--units deviation=um"):
        import_survey(tmp_path / "x.csv", MILL, joint="X", columns={"target": "Position", **said})
    result = import_survey(
        tmp_path / "x.csv", MILL, joint="X", columns={"target": "Position", **said}, units={"deviation": "um"}
    )
    check(result.survey.table)
    result.save(tmp_path / "s")
    check(read_survey(tmp_path / "s", MACHINE).table)


def test_figures_are_those_of_the_same_readings_one_below_the_other(tmp_path: Path) -> None:
    table("words").to_csv(tmp_path / "wide.csv", index=False)
    rows = [
        (t, k + 1, "-" if back else "+", UM[i, k, back])
        for k in range(RUNS)
        for back in (0, 1)
        for i, t in ([*enumerate(TARGETS)][::-1] if back else enumerate(TARGETS))
    ]
    long = pd.DataFrame(rows, columns=["target_mm", "cycle", "direction", "deviation_um"])
    long.to_csv(tmp_path / "long.csv", index=False)
    figures = []
    for name in ("wide", "long"):
        import_survey(tmp_path / f"{name}.csv", MILL, joint="X").save(tmp_path / name)
        figures.append(iso("230-2", MILL, tmp_path / name).figures)
    pd.testing.assert_frame_equal(*figures)


@pytest.mark.parametrize(
    "head", ["X soll;X ist", "Soll X [mm];Ist X [mm]", "Target;Measured", "Consigne X;Mesure X", "Teorico X;Misurato X"]
)
def test_nominal_and_actual_of_one_axis(head: str, tmp_path: Path) -> None:
    targets = np.concatenate([TARGETS, TARGETS[::-1]] * 2)
    read = targets + 1e-3 * np.concatenate([UM[:, 0, 0], UM[::-1, 0, 1], UM[:, 1, 0], UM[::-1, 1, 1]])
    (tmp_path / "x.csv").write_text(f"{head}\n" + "".join(f"{t};{v:.5f}\n" for t, v in zip(targets, read, strict=True)))
    result = import_survey(tmp_path / "x.csv", MILL, joint="X")
    frame = result.survey.table
    assert frame["run"].tolist() == ["1"] * 14 + ["2"] * 14
    assert frame["dir_X"].tolist() == [1.0] * 7 + [-1.0] * 7 + [1.0] * 7 + [-1.0] * 7
    np.testing.assert_allclose(frame["dx"], read.round(5) - targets, atol=1e-9)
    assert "nominal" in result.summary()


@pytest.mark.long
@pytest.mark.parametrize(
    ("nominal", "actual"),
    [("{} soll", "{} ist"), ("Soll {} [mm]", "Ist {} [mm]"), ("{} nominal", "{} actual"), ("Target_{}", "Measured_{}"),
     ("consigne {}", "mesure {}"), ("{} teorico", "{} misurato")],
)  # fmt: skip
def test_nominal_and_actual_of_three_axes(nominal: str, actual: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    at = rng.uniform([-150, -100, 250], [150, 100, 400], (20, 3)).round(3)
    data = pd.DataFrame(
        np.column_stack([at, at + rng.normal(0, 0.004, at.shape).round(4)]),
        columns=[*(nominal.format(a) for a in "XYZ"), *(actual.format(a) for a in "XYZ")],
    )
    data.to_csv(tmp_path / "a.csv", index=False, sep=";")
    result = run("import", tmp_path / "a.csv", "--machine", MILL, "--out", tmp_path / "s")
    assert result.code == 0, result.err
    assert "taken as measured. If the controller read them back" in " ".join(result.out.split())
    survey = read_survey(tmp_path / "s", MACHINE)
    np.testing.assert_allclose(survey.commands(["X", "Y", "Z"]), at)
    np.testing.assert_allclose(survey.measured, data.iloc[:, 3:])


READ = UM[:, 0, 0]
NO_TEST = {
    "polar coordinates": ("H;V;R", [TARGETS, READ, TARGETS]),
    "two units": ("Position;Run 1 + [um];Run 1 - [mm]", [TARGETS, READ, READ]),
    "something up and down": ("level;up;down", [TARGETS, READ, READ]),
    "a feed beside axes": ("X;Y;Z;F;R", [TARGETS] * 5),
    "measured coordinates by number": ("X;Y;Z;Measurement 1;Measurement 2;Measurement 3", [TARGETS] * 6),
    "a log": ("time;X soll;X ist", [TARGETS + 200, TARGETS, TARGETS]),
    "two axes": ("X soll;X ist;Y soll;Y ist", [TARGETS] * 4),
}


@pytest.mark.parametrize("what", NO_TEST)
def test_other_tables_are_no_positioning_test(what: str, tmp_path: Path) -> None:
    head, columns = NO_TEST[what]
    rows = "".join(";".join(map(str, row)) + "\n" for row in zip(*columns, strict=True))
    (tmp_path / "a.csv").write_text(f"{head}\n{rows}")
    assert format_of(open_raw(tmp_path / "a.csv", "a.csv")).name == "delimited-table"


def test_nominal_and_actual_of_the_only_axis_are_commands_beside_a_measured_file(tmp_path: Path) -> None:
    """What a control read back of them is no measurement."""
    axis = Machine("one axis", (Joint("X", "prismatic", (1.0, 0.0, 0.0), (-200.0, 200.0)),))
    at = np.random.default_rng(2).uniform(-150, 150, 20).round(3)
    pd.DataFrame({"X soll": at, "X ist": at + 0.002}).to_csv(tmp_path / "log.csv", index=False)
    pd.DataFrame({"mx": at + 0.01, "my": 0 * at, "mz": 0 * at}).to_csv(tmp_path / "seen.csv", index=False)
    found = import_survey(tmp_path / "seen.csv", axis, commands=tmp_path / "log.csv").survey.table
    assert "dx" not in found or found["dx"].isna().all()
    np.testing.assert_array_equal(found["X"], at)


def test_targets_in_degrees_are_of_no_linear_axis(tmp_path: Path) -> None:
    data = table("signs").rename(columns={"Target (mm)": "Target (deg)"})
    data.to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(InputError, match=r"target positions in 'deg', and X is prismatic.*--units target=mm"):
        import_survey(tmp_path / "x.csv", MILL, joint="X")


def test_coordinates_are_no_runs(tmp_path: Path) -> None:
    """`Actual Z` beside `Actual X` is an axis, and no way back (`zurück`)."""
    names = [f"{what} {axis}" for what in ("Nominal", "Actual", "Deviation") for axis in "XYZ"]
    rng = np.random.default_rng(1)
    nominal = rng.uniform(50, 350, (20, 3)).round(3)
    deviation = rng.normal(0, 0.01, (20, 3)).round(4)
    table = pd.DataFrame(np.hstack([nominal, nominal + deviation, deviation]), columns=names)
    table.to_csv(tmp_path / "s.csv", index=False)
    out = done("import", tmp_path / "s.csv", "--machine", MILL, "--out", tmp_path / "taken").out
    assert "mx = Actual X" in out
    assert "positioning test" not in out


@pytest.mark.parametrize(("row", "off", "refused"), [(3, 0.25, True), (3, 4e-5, False), (None, 10.0, True)])
def test_deviations_are_actual_less_nominal(row: int | None, off: float, refused: bool, tmp_path: Path) -> None:
    target = np.r_[0:400:11j, 400:0:11j].round(3)
    deviation = np.random.default_rng(1).normal(0, 0.005, len(target)).round(4)
    actual = target + deviation
    actual[slice(None) if row is None else row] += off
    table = pd.DataFrame({"Nominal [mm]": target, "Actual [mm]": actual.round(5), "Deviation [mm]": deviation})
    table.to_csv(tmp_path / "s.csv", index=False)
    said = run("import", tmp_path / "s.csv", "--machine", MILL, "--joint", "X", "--out", tmp_path / "taken")
    assert (said.code == 2) == refused
    assert ("Deviation is not Actual less Nominal" in said.err) == refused


@pytest.mark.parametrize("positions", [False, True])
def test_deviations_of_millimetres_are_a_wrong_unit(positions: bool, tmp_path: Path) -> None:
    """The coarsest screws are off by 0.05 mm in 300 mm: what is far beyond is refused, whatever the file states."""
    data = table("arrows", positions)
    if positions:
        data.iloc[:, 1:] = TARGETS[:, None] + 1000 * (data.iloc[:, 1:] - TARGETS[:, None])
    data.columns = [name.replace("µm", "mm") for name in data.columns]
    (tmp_path / "x.csv").write_text(data.to_csv(index=False), encoding="utf-8")
    word = "actual" if positions else "deviation"
    with pytest.raises(InputError, match=rf"error motions of X that vary by .* mm.*--units {word}=") as error:
        import_survey(tmp_path / "x.csv", MILL, joint="X")
    assert ("in um" in str(error.value)) is not positions  # a thousandth of a position is no deviation
    if not positions:
        check(import_survey(tmp_path / "x.csv", MILL, joint="X", units={word: "um"}).survey.table)
    stated = import_survey(tmp_path / "x.csv", MILL, joint="X", units={word: "mm"})
    assert "was stated" in stated.notes[0]
    assert "was stated" in iso("230-2", MACHINE, stated.survey).notes[0]


def test_positions_in_another_unit_than_their_targets(tmp_path: Path) -> None:
    head = "Nominal [mm];Actual [mm]\n"
    way = [*TARGETS, *TARGETS[::-1]] * 2
    (tmp_path / "x.csv").write_text(head + "".join(f"{q};{(q + 1e-5 * q) / 25.4:.6f}\n" for q in way))
    with pytest.raises(InputError, match=r"actual positions in mm that change by 0.0393.*--units actual=inch"):
        import_survey(tmp_path / "x.csv", MILL, joint="X")
    found = import_survey(tmp_path / "x.csv", MILL, joint="X", units={"actual": "inch"}).survey.table
    np.testing.assert_allclose(found["dx"], 1e-5 * np.array(way), atol=2e-5)


def test_targets_that_fill_the_travel_in_inches_are_doubted(tmp_path: Path) -> None:
    joint = next(j for j in MACHINE.joints if j.name == "X")
    low, high = (q + s * 5 for q, s in zip(joint.travel, (1, -1), strict=True))
    way = np.linspace(low, high, 9) / 25.4
    rows = "".join(f"{q:.4f},{q + 1e-4:.6f},0.0001\n" for q in (*way, *way[::-1]))
    (tmp_path / "x.csv").write_text(f"Nominal,Actual,Deviation\nmm,mm,mm\n{rows}")
    found = import_survey(tmp_path / "x.csv", MILL, joint="X")
    assert any("in inches they would cover" in note for note in found.notes)
    units = {"target": "inch", "actual": "inch", "deviation": "inch"}
    assert not import_survey(tmp_path / "x.csv", MILL, joint="X", units=units).notes


def test_standards_doubt_points_in_another_unit_first(tmp_path: Path) -> None:
    q = np.linspace(-150, 150, 9)
    rows = pd.DataFrame({"X": q, "Y": 0.0, "Z": 0.0, "mx": q / 25.4})
    rows.to_csv(tmp_path / "x.csv", index=False)
    assert "See the units" in iso("230-2", MACHINE, tmp_path / "x.csv").notes[0]
    rows.assign(mx=q * (1 + 1e-5)).to_csv(tmp_path / "x.csv", index=False)
    assert "See the units" not in "".join(iso("230-2", MACHINE, tmp_path / "x.csv").notes)


@pytest.mark.parametrize(
    "name",
    first_of(
        [
            "Lauf {k} {auf}",
            "{k}. Lauf {+}",
            "{k} {fwd} (in)",
            "Messung {k} {auf}wärts",
            "Run {k} {steigend} [inch]",
            "run {k} {up}",
        ],
        3,
    ),
)
def test_words_of_runs_side_by_side(name: str, tmp_path: Path) -> None:
    pairs = {"auf": "ab", "up": "down", "+": "-", "steigend": "fallend", "fwd": "rev"}
    inches = name.endswith(("[inch]", "(in)"))
    scale = 25.4 if inches else 1.0
    columns = {"Position [in]" if inches else "Position [mm]": TARGETS / scale}
    for k in range(RUNS):
        for back in (0, 1):
            words = {up: down if back else up for up, down in pairs.items()}
            columns[name.format(k=k + 1, **words)] = UM[:, k, back] / scale / (1e3 if inches else 1)
    pd.DataFrame(columns).to_csv(tmp_path / "x.csv", index=False, sep=";", decimal=",", float_format="%.12f")
    units = {} if inches else {"deviation": "um"}
    check(import_survey(tmp_path / "x.csv", MILL, joint="X", units=units).survey.table)


def wide(readings: np.ndarray, above: str = "") -> str:
    """A row a run, with its number and its direction in columns of their own; `readings`: (targets, runs, 2)."""
    text = above + "Lauf;Richtung;" + ";".join(f"{q:.1f}" for q in TARGETS) + "\n"
    for k in range(RUNS):
        for back, way in enumerate(("auf", "ab")):
            text += f"{k + 1};{way};" + ";".join(f"{v:.4f}" for v in readings[:, k, back]) + "\n"
    return text.replace(".", ",")


def test_a_row_a_run_with_numbers_and_directions(tmp_path: Path) -> None:
    """The axis and the unit stand above the table; positions have the unit of their targets."""
    positions = TARGETS[:, None, None] + UM / 1e3
    (tmp_path / "x.csv").write_text(wide(positions, "Messung X-Achse;Laserinterferometer;mm\n"))
    check(import_survey(tmp_path / "x.csv", MILL).survey.table)
    (tmp_path / "x.csv").write_text(wide(UM, "Achse: X;Abweichungen in um\n"))
    check(import_survey(tmp_path / "x.csv", MILL).survey.table)
    (tmp_path / "x.csv").write_text(wide(positions, "Achse: X\n"))
    result = import_survey(tmp_path / "x.csv", MILL, joint="Y")
    assert "the file says axis X, and --joint Y" in result.summary()
    (tmp_path / "x.csv").write_text(wide(positions, "X axis;inch\n"))
    with pytest.raises(InputError, match=r"fit the travels only if they are in mm.*--units target=mm"):
        import_survey(tmp_path / "x.csv", MILL)
    (tmp_path / "x.csv").write_text(wide(np.roll(positions, 1, axis=0)))
    with pytest.raises(InputError, match=r"near other targets than their own: 150.* at target -150"):
        import_survey(tmp_path / "x.csv", MILL, joint="X")


@pytest.mark.parametrize("positions", [False, True])
def test_deviations_alone_prove_no_order(positions: bool, tmp_path: Path) -> None:
    table("arrows", positions).to_csv(tmp_path / "x.csv", index=False)
    said = (
        "shifted by one, or two that are exchanged, do not show"
        in import_survey(
            tmp_path / "x.csv",
            MILL,
            joint="X",
            units={"actual" if positions else "deviation": "mm" if positions else "um"},
        ).summary()
    )
    assert said is not positions


def listed(tmp_path: Path, lines: list[str]) -> Path:
    """A list of targets and positions in the order of measuring."""
    path = tmp_path / "list.csv"
    path.write_text("\n".join(["Soll [mm];Ist [mm]", *lines]) + "\n")
    return path


def test_lists_with_lost_or_exchanged_readings_are_refused(tmp_path: Path) -> None:
    """Sides of approach come from the order of the lines: what is missing or elsewhere would count for another side."""
    order = [(t, k, back) for k in range(RUNS) for back in (0, 1) for t in range(len(TARGETS))[:: -1 if back else 1]]
    lines = [f"{TARGETS[t]:.3f};{TARGETS[t] + UM[t, k, back] / 1e3:.6f}" for t, k, back in order]
    result = import_survey(listed(tmp_path, lines), MILL, joint="X").survey.table
    assert len(result) == len(lines)
    several = len(TARGETS)
    for wrong in (
        [*lines[: several + 2], *lines[several + 4 :]],  # two lines are missing
        [*lines[:several], *lines[2 * several :]],  # a pass is missing
        [*lines[:1], lines[2], lines[1], *lines[3:]],  # two lines exchanged
    ):
        with pytest.raises(InputError, match=r"a pass by the order of its targets that lacks .*add columns"):
            import_survey(listed(tmp_path, wrong), MILL, joint="X")
    (one, first), (other, second) = (line.split(";") for line in lines[1:3])
    exchanged = [lines[0], f"{one};{second}", f"{other};{first}", *lines[3:]]
    with pytest.raises(InputError, match=r"line 3: a reading .* mm off its target.*line 4.*exchanged"):
        import_survey(listed(tmp_path, exchanged), MILL, joint="X")
    lost = [*lines[:4], f"{lines[4].split(';')[0]};0.000000", *lines[5:]]
    with pytest.raises(InputError, match=r"line 6: a reading .* mm off its target, where the others are within"):
        import_survey(listed(tmp_path, lost), MILL, joint="X")
