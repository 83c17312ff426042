"""Report of a fit: figures, tables and sentences rendered by the HTML template."""

from __future__ import annotations

from pathlib import Path

from errormodel import __version__
from errormodel.files import write_text_atomic
from identification.diagnosis.pipeline import Diagnosed
from identification.estimation.result import Fit
from identification.report import tables, wording
from identification.report.budget import budget_part
from identification.report.diagnosis import diagnosis_part
from identification.report.outliers_and_poses import gain_part, outliers_part
from identification.report.page import environment, page
from identification.report.pictures import pictures
from identification.report.posterior import posterior_part
from identification.report.thermal import thermal_part
from identification.results.parameter_table import estimates
from identification.thermal.run import Thermal


def load() -> None:
    """Load libraries and templates in advance, which the first page needs."""
    import GTC  # noqa: F401
    import scipy.spatial.transform
    import scipy.special  # noqa: F401

    for name in environment().list_templates():
        environment().get_template(name)


def write_report(fit: Fit, path: Path, diagnosed: Diagnosed | None = None, thermal: Thermal | None = None) -> None:
    """Write the :func:`report` of `fit` to `path`."""
    write_text_atomic(report(fit, diagnosed, thermal), path)


def report(fit: Fit, diagnosed: Diagnosed | None = None, thermal: Thermal | None = None) -> str:
    """Report of `fit` as self-contained HTML; the same fit gives the same text.

    With a diagnosis or a thermal model, `fit` is that of the extended machine, and the findings come first.
    """
    groups = estimates(fit)
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
        pictures=pictures(fit, short=diagnosed is not None),
        sections=tables.group_sections(groups),
        counts=tables.counts(fit),
        dependent=tables.dependent(fit),
        no_effect=tables.no_effect(fit),
        correlated=wording.strongest_correlation(fit),
        effects=bool(fit.chain.machine.effects),
        posterior=posterior_part(fit),
        budget=budget_part(fit),
        outliers=outliers_part(fit),
        gain=gain_part(fit),
        frames=tables.frames(fit),
        frame_mode=fit.survey.frame,
        noise=tables.noise(fit),
        noise_text=wording.noise(fit),
        inputs=tables.inputs(fit),
        version=__version__,
    )
