"""Report of a fit: figures, tables and sentences rendered by the HTML template."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from errormodel import __version__
from errormodel.files import write_text_atomic
from identification.report import tables, wording
from identification.report.budget import budget_part
from identification.report.outliers_and_poses import gain_part, outliers_part
from identification.report.page import page
from identification.report.pictures import pictures
from identification.report.record_head import head_of
from identification.report.singular_values import singular_values_part
from identification.results.analysis import Analysis

if TYPE_CHECKING:
    from identification.diagnosis.results.diagnosed import Diagnosed
    from identification.report.diagnosis import DiagnosisPart
    from identification.report.posterior import PosteriorPart
    from identification.report.thermal import ThermalPart
    from identification.thermal_drift.drift_model import Thermal


def write_report(
    analysis: Analysis, path: Path, diagnosed: Diagnosed | None = None, thermal: Thermal | None = None
) -> None:
    """Write the :func:`report` of a fit to `path`."""
    write_text_atomic(report(analysis, diagnosed, thermal), path)


def report(analysis: Analysis, diagnosed: Diagnosed | None = None, thermal: Thermal | None = None) -> str:
    """The report of a fit: HTML that holds all it shows; same fit, same text.

    With a diagnosis or a thermal model, the fit is that of the extended machine, and what was found comes first.
    """
    fit = analysis.fit
    return page(
        "report.html",
        machine=fit.chain.machine.name,
        headline=wording.headline(fit),
        diagnosis=_diagnosis(diagnosed),
        thermal=_thermal(thermal),
        judgements=wording.judgements(fit),
        notes=fit.notes,
        head=head_of(fit.survey.record),
        results=tables.results(fit),
        motions=tables.motions(fit),
        readings=tables.readings(fit),
        set_ups=tables.of_set_ups(fit),
        pictures=pictures(fit),
        singular_values=singular_values_part(fit),
        sections=tables.group_sections(analysis.estimates),
        location_errors=tables.location_rows(analysis.location_errors),
        counts=tables.counts(fit),
        dependent=tables.dependent(fit),
        no_effect=tables.no_effect(fit),
        correlated=wording.strongest_correlation(analysis),
        pairs=tables.correlated_pairs(analysis),
        effects=bool(fit.chain.machine.effects),
        posterior=_posterior(analysis),
        budget=budget_part(analysis),
        outliers=outliers_part(fit),
        gain=gain_part(analysis),
        frames=tables.frames(fit),
        frame_mode=fit.survey.frame,
        noise=tables.noise(fit),
        noise_text=wording.noise(fit),
        inputs=tables.inputs(fit),
        version=__version__,
    )


# What a section is made from is loaded where there is one: a plain fit needs neither search nor sampler.


def _diagnosis(diagnosed: Diagnosed | None) -> DiagnosisPart | None:
    if diagnosed is None:
        return None
    from identification.report.diagnosis import diagnosis_part

    return diagnosis_part(diagnosed)


def _thermal(thermal: Thermal | None) -> ThermalPart | None:
    if thermal is None:
        return None
    from identification.report.thermal import thermal_part

    return thermal_part(thermal)


def _posterior(analysis: Analysis) -> PosteriorPart | None:
    if analysis.posterior is None:
        return None
    from identification.report.posterior import posterior_part

    return posterior_part(analysis.posterior)
