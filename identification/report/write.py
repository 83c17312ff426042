"""`report`: figures, tables and words of a fit, put into the template."""

from __future__ import annotations

from pathlib import Path

from errormodel import __version__
from errormodel.files import write_text_atomic
from identification.diagnosis.results.diagnosed import Diagnosed
from identification.report import tables, wording
from identification.report.budget import budget_part
from identification.report.diagnosis import diagnosis_part
from identification.report.outliers_and_poses import gain_part, outliers_part
from identification.report.page import environment, page
from identification.report.pictures import pictures
from identification.report.posterior import posterior_part
from identification.report.thermal import thermal_part
from identification.results.analysis import Analysis
from identification.thermal.run import Thermal


def load() -> None:
    """Load what is else loaded while the first page is made: libraries and templates."""
    import GTC  # noqa: F401
    import scipy.spatial.transform
    import scipy.special  # noqa: F401

    for name in environment().list_templates():
        environment().get_template(name)


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
        diagnosis=diagnosis_part(diagnosed) if diagnosed else None,
        thermal=thermal_part(thermal) if thermal else None,
        judgements=wording.judgements(fit),
        notes=fit.notes,
        results=tables.results(fit),
        motions=tables.motions(fit),
        pictures=pictures(analysis, short=diagnosed is not None),
        sections=tables.group_sections(analysis.estimates),
        counts=tables.counts(fit),
        dependent=tables.dependent(fit),
        no_effect=tables.no_effect(fit),
        correlated=wording.strongest_correlation(analysis),
        effects=bool(fit.chain.machine.effects),
        posterior=posterior_part(analysis.posterior),
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
