"""The user's priors: file form and reader of ``--priors``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from errormodel import yamlfile
from errormodel.exceptions import InputError
from errormodel.yamlfile import Document, FileModel, Number, VersionedModel


class PriorForm(FileModel):
    """A normal prior, bounds, or both, in mm, rad and derived units, as in parameters.csv."""

    mean: Number = Field(0.0, description="a number: the middle of the normal prior, such as 0")
    std: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="its standard deviation, above 0, such as 2.0e-5"
    )
    low: Number | None = Field(None, description="the smallest possible value, such as 0")
    high: Number | None = Field(None, description="the largest possible value, such as 1.0e-4")


class PriorsForm(VersionedModel):
    """``priors.yaml``: priors by name of parameters, noise levels, shape parameters of effects and outliers."""

    priors: dict[str, PriorForm] = Field(
        {}, description="a block such as {X.dx.1: {std: 2.0e-5}, T3.ec: {low: 0, high: 1.0e-4}}"
    )


def priors_of(
    source: Mapping[str, Mapping[str, float]] | str | Path | None, bounds_only: bool
) -> tuple[Mapping[str, PriorForm], Document | None]:
    """What is known beforehand, of a file or a dict; `bounds_only` for least squares, which use nothing else.

    Raises
    ------
    InputError
        It is wrong, or has a normal prior for a fit that is not Bayesian.
    """
    if source is None:
        return {}, None
    given, document = read_priors(source)
    for name, form in given.items():
        if form.std is not None and bounds_only:
            found = "a normal prior (std), which least squares do not use: they take bounds only"
            raise prior_error(document, name, found, "Add --bayes, or leave low and high alone")
    return given, document


def read_priors(source: Mapping[str, Mapping[str, float]] | str | Path) -> tuple[dict[str, PriorForm], Document]:
    """Read and check the file, or the dict of its ``priors``; names in it are checked against the model later.

    Raises
    ------
    InputError
        A key or value is wrong, or a prior contradicts itself.
    """
    if isinstance(source, str | Path):
        document = yamlfile.load(Path(source))
    else:
        whole = {"errormodel": 1, "priors": {name: dict(form) for name, form in source.items()}}
        document = yamlfile.parse(json.dumps(whole, default=str), "priors")
    form = yamlfile.validate(document, PriorsForm)
    for name, prior in form.priors.items():
        keys = ("priors", name)
        if prior.std is None and prior.low is None and prior.high is None:
            raise document.error(keys, "no prior: neither std nor a bound", "Write {std: 2.0e-5} or {low: 0}")
        if prior.low is not None and prior.high is not None and prior.low >= prior.high:
            found = f"low {prior.low:g} is not below high {prior.high:g}: no value is possible"
            raise document.error(keys, found, "Exchange or widen the bounds")
        low = -float("inf") if prior.low is None else prior.low
        high = float("inf") if prior.high is None else prior.high
        if prior.std is not None and not low - 5 * prior.std < prior.mean < high + 5 * prior.std:
            found = f"mean {prior.mean:g} ± {prior.std:g} lies over 5 standard deviations outside its own bounds"
            raise document.error(keys, found, "Move the mean, or widen the bounds or std")
    return form.priors, document


def prior_error(document: Document | None, name: str, found: str, cure: str) -> InputError:
    """Error about a prior, with its line if it comes from a file."""
    return document.error(("priors", name), found, cure) if document else InputError(f"prior {name}", found, cure)
