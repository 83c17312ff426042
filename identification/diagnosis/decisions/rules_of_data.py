"""The rules that decide about mistakes in a survey and about its outliers, before and beside the search."""

from __future__ import annotations

from identification.diagnosis.decisions.rule import COUNT, GAIN, RATIO, SHARE, Rule
from identification.diagnosis.decisions.rule import decided as _decided
from identification.diagnosis.decisions.rule import in_module as _in
from identification.diagnosis.decisions.stages import DATA, OUTLIERS

_RUNS, _COLUMNS, _ROWS = "data_checks.runs_of_motions", "data_checks.columns", "data_checks.rows"
_SENSORS = "data_checks.temperature_sensors"
_COPIES, _CONTAMINATED = "data_checks.duplicates_and_clock", "data_checks.contaminated_noise"

RULES_OF_DATA: dict[str, Rule] = {
    "run-lost-zero": Rule(
        DATA,
        "standard uncertainties",
        "A run of error motions that steps beside the others lost its zero.",
        _in(_RUNS, "CLEAR_STEP", "LARGE_STEP", "STEP_OVER_DRIFT", "FEWEST_ASIDE"),
    ),
    "run-opposite-sign": Rule(
        DATA, "", "A run of error motions of the opposite sign of the others is named.", _in(_RUNS, "CLEAR_FACTOR")
    ),
    "reading-opposite-sign": Rule(
        DATA,
        GAIN,
        "Readings whose mirror image fits the rest of the survey clearly better are taken so.",
        _decided("DECISIVE_ODDS") + _in("data_checks.opposite_readings", "WORST"),
    ),
    "copied-rows": Rule(
        DATA,
        COUNT,
        "Rows that repeat earlier readings to the last digit are left out.",
        _in(_COPIES, "CHANCE", "REPEATS"),
    ),
    "clock-set-back": Rule(DATA, COUNT, "Time that falls back within a run is taken to go on.", _in(_COPIES, "RESETS")),
    "first-approach": Rule(
        DATA,
        GAIN,
        "Of a direction of approach that nothing states the likelier sign is taken.",
        _in("data_checks.first_approach", "CLEAR"),
    ),
    "nominal-misfit": Rule(
        DATA,
        "misfit per spread of the points",
        "Columns are examined only where the nominal machine misses by more than errors of a machine.",
    ),
    "wrong-column": Rule(
        DATA,
        "misfit per spread of the points",
        "A change of whole columns with which the nominal machine fits so much better is a mistake in them.",
        _in(_COLUMNS, "BETTER", "RIGHT", "ZERO", "TWO", "FIRST", "ALIKE", "NEAR"),
    ),
    "wrong-hand": Rule(
        DATA,
        RATIO,
        "Points in a plane are left-handed where declared errors explain their mirror image.",
        _in("data_checks.declared_errors", "CLEAR", "CLEARLY"),
    ),
    "late-column": Rule(
        DATA,
        RATIO,
        "Commands of some joints that fit a few rows further on are taken from there.",
        _in(_ROWS, "BETTER") + _in(_COLUMNS, "TWO", "ALIKE"),
    ),
    "rows-elsewhere": Rule(
        DATA,
        COUNT,
        "Rows that fit in another order, run or column are put there.",
        _in(_ROWS, "FAR", "NEAR", "MOST", "CLEARLY", "BETTER", "REST", "LATEST"),
    ),
    "most-mistakes": Rule(
        DATA, COUNT, "No more mistakes than this are put right.", _in("data_checks.checks", "MOST_BLUNDERS")
    ),
    "no-cure": Rule(
        DATA,
        "um",
        "Changes of columns that leave far more than a machine's errors are no cure, and are refused.",
        _in(_COLUMNS, "TWO") + _in(_ROWS, "BETTER"),
    ),
    "unrelated-points": Rule(
        DATA,
        RATIO,
        "Measured points that fit their commands no better than those of any other row are refused.",
        _in("data_checks.unrelated", "RELATED", "SHUFFLES"),
    ),
    "approach-column": Rule(
        DATA,
        SHARE,
        "A column of the side of approach that contradicts the order of the rows is named.",
        _in("data_checks.approach_direction", "CONTRARY", "FEWEST"),
    ),
    "sensor-fault": Rule(
        DATA,
        "",
        "A sensor that is dead, stuck, torn off or loose drives nothing.",
        _in(_SENSORS, "COLDEST", "WARMEST", "HOTTEST", "STUCK", "STEPS", "SUDDEN", "ALIVE", "NOISY", "SPIKE_KELVIN"),
    ),
    # ---- outliers
    "gross-outlier": Rule(
        OUTLIERS,
        "um",
        "Rows whose residual is longer than the noise, with its tails, ever makes one, are out.",
        _in("data_checks.outliers", "GROSS", "NEARLY", "CHANCE") + _in(_CONTAMINATED, "TAILS"),
    ),
    "contaminated-noise": Rule(
        OUTLIERS,
        GAIN,
        "A few rows of wider noise are left out, heavy tails are not.",
        _decided("LEAST_EVIDENCE", "DECISIVE_ODDS") + _in(_CONTAMINATED, "TAILS", "WIDER", "SHARES"),
    ),
    "outlier-share": Rule(
        OUTLIERS, SHARE, "Where more rows than this would be so, none is.", _in("data_checks.outliers", "MOST")
    ),
    "outliers-explained": Rule(
        OUTLIERS, COUNT, "Rows that the findings explain are no outliers, and the search begins again with them."
    ),
}
