"""Schema of ``survey.yaml``; a bare table is a survey with the default settings."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union

from pydantic import BeforeValidator, ConfigDict, Field, field_validator, model_validator

from errormodel.instruments import instruments
from errormodel.instruments.base import Instrument, Positive
from errormodel.instruments.plain import Plain
from errormodel.observations import registry as observations
from errormodel.observations.base import Observation
from errormodel.raw_formats.commanded_circle import CommandedCircle
from errormodel.surveys.record import RecordForm
from errormodel.units import UnitsBlock
from errormodel.yamlfile import Document, FileModel, Vector3, VersionedModel, load, validate

SURVEY_FILE = "survey.yaml"

Role = Literal["fit", "test"]
Frame = Literal["shared", "per-run", "per-file", "fixed"]
Refit = Literal["frame", "tool"]
Axes = Literal["reference", "tool"]  # along which mx my mz were read

if TYPE_CHECKING:
    AnyInstrument: TypeAlias = Instrument
    AnyObservation: TypeAlias = Observation
else:
    AnyInstrument = Annotated[Union[tuple(instruments().values())], Field(discriminator="type")]  # noqa: UP007
    AnyObservation = Annotated[Union[tuple(observations().values())], Field(discriminator="type")]  # noqa: UP007


class SurveyUnits(UnitsBlock):
    """Units by kind or by column: ``{length: mm, dx: um, T_bed: degF}``.

    A kind applies to positions, measured coordinates, tools and uncertainties. Rotation vectors and angular error
    motions are in rad, feeds in mm/min and payloads in kg unless their column is named.
    """

    model_config = ConfigDict(extra="allow")  # units of columns, which `errormodel.surveys.columns.check_units` checks

    time: str = Field("s", description="a unit of time, such as s, ms, min or h")
    temperature: str = Field("degC", description="a unit of temperature, such as degC, K or degF")
    reading: str = Field("rad", description="unit of the column angle, whose name is that of a kind, such as arcsec")

    @property
    def of_columns(self) -> dict[str, Any]:
        """Units of single columns, by column name."""
        return self.model_extra or {}


class RawEntry(FileModel):
    """A file as an instrument or a controller wrote it, and how its columns are read."""

    path: str = Field(min_length=1, description="the file, relative to this one")
    format: str = Field("", description="a raw format, such as spreadsheet; left out: a survey's own table")
    sha256: str = Field("", pattern="^([0-9a-f]{64})?$", description="digest of the file as it was imported")
    columns: dict[str, str] = Field(
        {},
        description='our column name: its own ("-" before it: other sign; "-" alone: left out), such as {mx: East}',
    )
    units: dict[str, str] = Field({}, description="of this raw file, by kind or our column, such as {length: m}")
    dates: Literal["", "day-first", "month-first"] = Field("", description="day-first or month-first")
    joint: str = Field("", description="the joint that a file is about which holds readings of one joint")
    offsets: list[str] = Field([], description='of a programme, as --offset of compensate, such as ["G54=X0,Y0,Z300"]')
    at: list[str] = Field([], description='of a programme, as --at of compensate, such as ["start=X0,Y0,Z0"]')
    dialect: str = Field("auto", description="of a programme, as --dialect: auto, iso, fanuc, fanuc-calculator ...")
    sheet: str = Field(
        "", description="of a workbook: the sheet that is read; left out: the first that is no cover sheet"
    )
    circle: CommandedCircle | None = Field(
        None, description="of a trace of a bar's length over its angle: the circle that was commanded"
    )
    observation: str = Field("", description="of a trace: the entry of observations: that its readings are of")


class LogEntry(RawEntry):
    """A recording on a clock of its own, such as a log of temperatures, that is read at the times of the rows."""

    offset: float = Field(0.0, description="s to add to its times")


class TargetPlace(FileModel):
    """Where a target is in the last frame, mm, and how well that is known."""

    place: Vector3 | None = Field(None, description="its functional point (mm), such as [0, 0, 50]")
    near: Vector3 | None = Field(None, description="about where it is (mm): its place is an unknown of the fit")
    sigma: Positive | None = Field(None, description="standard uncertainty (mm) of each coordinate of its place")

    @model_validator(mode="after")
    def _one(self) -> TargetPlace:
        if (self.place is None) == (self.near is None):
            raise ValueError("Write place: [x, y, z] of a known place, or near: [x, y, z] of one to estimate")
        if self.near is not None and self.sigma is not None:
            raise ValueError("Write place: beside sigma:; near: is a place that nobody knows")
        return self

    @property
    def point(self) -> tuple[float, float, float]:
        x, y, z = self.place or self.near or (0.0, 0.0, 0.0)
        return x, y, z


def _place(value: object) -> object:
    return {"place": value} if isinstance(value, list) else value


class FileEntry(RawEntry):
    """One table, and whether it is fitted or held out as a test; a raw file with its commands."""

    path: str = Field(min_length=1, description="a CSV or Parquet file, or a folder of parts, relative to this file")
    role: Role = Field("fit", description="fit (the parameters come from it) or test (held out)")
    commands: RawEntry | None = Field(None, description="the file with the commands: a block as of a raw file")
    pairs: str = Field("", description="CSV of which rows were measured at which command: command, first, last")
    targets: dict[str, Annotated[TargetPlace, BeforeValidator(_place)]] = Field(
        {},
        description="functional point (mm) of each target, such as {A: [0, 0, 50], B: {near: [9, 0, 50]}}",
    )
    axes: Axes = Field(
        "reference", description="of mx my mz: tool, of a nest in the spindle whose readings are along its own axes"
    )

    @model_validator(mode="after")
    def _raw(self) -> FileEntry:
        own = self.model_fields_set - {"path", "role", "format"}
        if own and not self.format:
            key = min(own)
            rest = f", or {key}: of the whole survey" if key in SurveyForm.model_fields else ""
            raise ValueError(f"Write format: beside {key}:, as errormodel import writes it{rest}")
        if self.commands is not None and not self.pairs:
            raise ValueError("Write pairs: beside commands:, the file that says which rows belong together")
        return self


Distribution = Literal["normal", "rectangular", "triangular", "arcsine"]
# half width over standard uncertainty (GUM 4.3; arcsine: GUM Supplement 1, 6.4.6)
DISTRIBUTION_DIVISORS: dict[Distribution, float] = {"rectangular": 3**0.5, "triangular": 6**0.5, "arcsine": 2**0.5}


class BudgetEntry(FileModel):
    """One contribution to the uncertainty budget that the data do not contain, and the quantity it acts on."""

    name: str = Field(min_length=1, description="what it is, such as scale factor of the tracker")
    std: Positive | None = Field(None, description="its standard uncertainty (k = 1), above 0, such as 0.2")
    half_width: Positive | None = Field(None, description="half of the width of its bounds, above 0, such as 0.5e-6")
    distribution: Distribution | None = Field(None, description="between the bounds, such as rectangular")
    dof: Positive | None = Field(None, description="degrees of freedom, above 0; left out: infinitely many")
    type: Literal["A", "B"] = Field("B", description="A (from a statistical analysis) or B")
    acts: str = Field(
        "prediction",
        description="what it acts on: prediction (mm), scale (of all measured lengths, 1), or a column: a temperature "
        "T_bed (K), tool_x (mm), a joint (mm, rad)",
    )

    @model_validator(mode="after")
    def _one(self) -> BudgetEntry:
        if (self.std is None) == (self.half_width is None):
            raise ValueError("Write either std or half_width")
        if self.std is None and self.distribution == "normal":
            raise ValueError("Write std: a normal distribution has no bounds")
        if self.std is not None and self.distribution not in (None, "normal"):
            raise ValueError("Write half_width: of this distribution the bounds are known")
        return self

    @property
    def shape(self) -> Distribution:
        """Its distribution; rectangular by default where bounds are given, else normal."""
        return self.distribution or ("rectangular" if self.std is None else "normal")

    @property
    def standard(self) -> float:
        """Its standard uncertainty."""
        return self.std if self.std is not None else (self.half_width or 0.0) / DISTRIBUTION_DIVISORS[self.shape]


class SurveyForm(VersionedModel):
    """``survey.yaml``."""

    files: list[FileEntry] = Field(min_length=1, description="a list such as [{path: data.csv, role: fit}]")
    frame: Frame = Field("shared", description="which rows share a measuring frame")
    frame_rotation: Vector3 | None = Field(
        None,
        description="three angles in degrees such as [0, 0, 90], for what the points leave open",
    )
    refit: list[Refit] = Field(["frame"], description="what a test file estimates for itself, such as [frame, tool]")
    columns: dict[str, str] = Field({}, description='our column name: the name in your files, such as {mx: "X meas"}')
    units: SurveyUnits = Field(default_factory=SurveyUnits, description="a block such as {length: mm, angle: deg}")
    instrument: AnyInstrument = Field(
        default_factory=Plain, description="a block such as {type: cmm, sigma: [1e-3, 2e-6]}"
    )
    logs: list[LogEntry] = Field(
        [], description="recordings on clocks of their own, such as [{path: t.csv, format: ..}]"
    )
    observations: dict[Annotated[str, Field(pattern=r"^[^\[\],]+$")], AnyObservation] = Field(
        {},
        description="what single readings are of: blocks with type and keys, by the names in the column observation",
    )
    budget: list[BudgetEntry] = Field([], description="lines such as [{name: tool, std: 0.002, acts: tool_z}]")
    notes: list[str] = Field([], description="what every command repeats, such as [the order was not proven]")
    test: RecordForm | None = Field(None, description="a block such as {operator: .., date: 2026-11-20, machine: {..}}")

    def all_notes(self) -> list[str]:
        """What a user should know: the notes of the file, and how it is understood."""
        if self.instrument.stated or isinstance(self.instrument, Plain):
            return self.notes
        own = self.instrument.type
        return [
            *self.notes,
            f"instrument {own}: no uncertainties of it are stated; its noise is estimated from the residuals",
        ]

    @field_validator("files")
    @classmethod
    def _once(cls, files: list[FileEntry]) -> list[FileEntry]:
        paths = [Path(entry.path) for entry in files]
        twice = next((str(p) for p in paths if paths.count(p) > 1), None)
        if twice:  # a file that is both fitted and held out is no test
            raise ValueError(f"Name {twice} once")
        return files

    @field_validator("columns")
    @classmethod
    def _distinct(cls, columns: dict[str, str]) -> dict[str, str]:
        for ours, theirs in columns.items():
            other = next((o for o, t in columns.items() if t == theirs and o != ours), None)
            if other:
                raise ValueError(f"Give {ours} and {other} a column each")
        return {ours: " ".join(theirs.split()) for ours, theirs in columns.items()}


def read_form(path: Path) -> tuple[SurveyForm, Document, Path]:
    """Read the settings of a survey.

    A folder with a ``survey.yaml`` stands for that file. Any other path without the suffix ``.yaml`` or ``.yml`` is a
    table (or a folder of its parts) with default settings.

    Returns
    -------
    form : SurveyForm
    document : Document
        Behind the form, for messages.
    folder : Path
        Base of the form's relative paths.
    """
    with suppress(OSError):  # a name that is too long: opening it gives the reason
        path = path / SURVEY_FILE if (path / SURVEY_FILE).is_file() else path
    if path.suffix.lower() in (".yaml", ".yml"):
        document = load(path)
        form = validate(document, SurveyForm)
        for key in ("columns", "units"):
            if document.data.get(key) and all(entry.format for entry in form.files):
                found = "which no file reads: all have format:, and columns and units of their own"
                raise document.error((key,), found, f"Write {key}: beside path: in files:, or leave out format: there")
        return form, document, path.parent
    bare = SurveyForm.model_construct(errormodel=1, files=[FileEntry(path=str(path))])  # nothing to validate
    return bare, Document(str(path), {}, {(): 1}), Path()
