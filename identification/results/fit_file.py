"""Schema of ``fit.json`` as far as it is read back."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue

from errormodel.chain import Chain
from errormodel.effects import make
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.yamlfile import Number, Vector3
from identification.results.versions import validate
from identification.uncertainty.other_effects import OtherEffect

INSTRUMENT_MEMBER = re.compile(r"(frame(\[.*\])?|zero\[.*\])\.(d[xyz]|e[abc])", re.DOTALL)  # no parameter of a chain

DATE = r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}$"
NotNegative = Annotated[Number, Field(ge=0)]
Figure = NotNegative | None  # JSON has null for what was not computed


LONGEST_ROTATION = math.pi * (1 + 1e-9)  # rad; a longer rotation vector is another rotation, which nobody wrote


def _turned(vector: list[float]) -> list[float]:
    if math.hypot(*vector) > LONGEST_ROTATION:
        raise ValueError("no rotation vector: it is longer than pi")
    return vector


def _as_many(series: list[list[float]]) -> list[list[float]]:
    if [len(values) for values in series] != 2 * [len(series[0]) if series else 0] or not series[0]:
        raise ValueError("no series: it is [[times], [temperatures]], as many of these as of those")
    return series


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)  # keys of later versions are additions


class _Parameter(_Part):
    id: str
    group: str
    symbol: str
    value: Number
    std: NotNegative
    unit: str
    members: Annotated[dict[str, Number], Field(min_length=1)]


class _Pose(_Part):
    translation: Vector3
    rotation: Annotated[Vector3, AfterValidator(_turned)]
    undetermined: list[Vector3] = []


class _Frame(_Part):
    label: str
    alignment: _Pose


class _Spread(_Part):
    rms_um: Figure
    mean_um: Figure
    max_um: Figure
    n: Annotated[int, Field(ge=0)]


class _Test(_Part):
    path: str
    frame: list[_Frame] = []


class _Noise(_Part):
    sigma: Figure
    declared: bool


class _LocationError(_Part):
    symbol: str
    words: str
    unit: str
    members: dict[str, Number]
    at: str = ""  # of older versions: by the constants of shapes, wherever


class _SetUp(_Part):
    id: str
    value: Number
    unit: str


class _OtherEffect(_Part):
    effect: Annotated[int, Field(ge=0)]
    options: dict[str, JsonValue]  # as the effect has them: `_check_other` makes it
    weight: Annotated[Number, Field(ge=0, le=1)]
    parameters: dict[str, Number]
    name: str = ""


class FitFile(_Part):
    """The keys of ``fit.json`` that prediction, compensation and monitoring use."""

    parameters: list[_Parameter]
    frame_mode: Literal["shared", "per-run", "per-file", "fixed"]
    frame: list[_Frame]
    nominal: _Spread
    fitted: _Spread
    test: list[_Test]
    noise: dict[str, _Noise]
    location_errors: list[_LocationError] = []
    clock_zero: Annotated[str, Field(pattern=DATE)] | None = None
    covered: dict[str, Annotated[list[Number], Field(min_length=2, max_length=2)]] = {}
    temperatures: dict[str, Annotated[list[list[Number]], AfterValidator(_as_many)]] = {}
    temperature_noise: dict[str, NotNegative] = {}
    runs: list[str] = []
    open_signs: bool = False
    unmeasured: dict[str, list[Literal["x", "y", "z"]]] = {}
    robust: bool = False
    sigma_um: NotNegative | None = 0.0  # none of positions
    sigma_interval_um: list[Figure] = []
    coverage: Annotated[Number, Field(gt=0)] = 1.0
    systematic_um: NotNegative = 0.0
    systematic_by: Literal["repeats", "declared", "recorded"] | None = None
    other_effects: list[_OtherEffect] = []
    expansions: dict[str, dict[str, NotNegative]] | None = None
    observations: list[_SetUp] = []


def check_fit(path: Path, data: dict[str, Any]) -> None:
    """Check types, lengths and finite numbers of ``fit.json``.

    Raises
    ------
    InputError
        About the first wrong key.
    """
    validate(FitFile, path, data, "Run the fit again")


def check_parameters(path: Path, data: Mapping[str, Any], chain: Chain) -> None:
    """Check that units and members of the groups are those of the machine beside the file, and that there is a frame.

    Raises
    ------
    InputError
        About the first that is not.
    """
    units = {str(o["id"]): str(o["unit"]) for o in data.get("observations", ())}  # of set-ups' unknowns
    for p in data["parameters"]:
        where = f"{path}, parameter '{p['id']}'"
        foreign = (m for m in p["members"] if m not in chain.index and m not in units)
        unknown = next((m for m in foreign if not INSTRUMENT_MEMBER.fullmatch(m)), None)
        if unknown is not None:
            raise InputError(where, f"the member '{unknown}', which the machine does not have", "Run the fit again")
        unit = units.get(p["id"]) or unit_of_parameter(p["id"], chain)
        if p["unit"] != unit:
            raise InputError(where, f"the unit '{p['unit']}', where the machine's is {unit}", "Run the fit again")
    for other in data.get("other_effects", ()):
        _check_other(f"{path}, key other_effects", other, chain.machine.effects)
    if data["fitted"]["n"] and not data["frame"] and data["frame_mode"] != "fixed":
        raise InputError(f"{path}, key frame", "no measuring frame", "Run the fit again")


def _check_other(where: str, other: Mapping[str, Any], specs: Sequence[EffectSpec]) -> None:
    """Check that the machine has the effect of which another is given, and that there can be such a one."""
    number, cure = other["effect"], "Run the diagnosis again"
    if number > len(specs) or (number == len(specs) and not other.get("name")):  # by name it may be one more
        raise InputError(where, f"the effect number {number + 1}, which the machine does not have", cure)
    try:
        make(OtherEffect(number, other["options"], 0.0, {}, other.get("name", "")).spec(specs))
    except InputError as error:
        raise InputError(where, f"of the effect number {number + 1}: {error.found}", cure) from error


def unit_of_parameter(identity: str, chain: Chain) -> str:
    """Unit of a parameter of the chain, of a measuring frame or of an instrument's zero."""
    if identity in chain.index:
        return chain.parameters[chain.index[identity]].unit
    return "mm" if identity.rpartition(".")[2] in ("dx", "dy", "dz") else "rad"
