"""Posterior draws as a netCDF-4 file that ``arviz.from_netcdf`` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from errormodel import __version__
from errormodel.arrays import Array
from errormodel.files import replacing
from identification.bayes.posterior import Posterior
from identification.estimation.result import Fit


def write_netcdf(fit: Fit, posterior: Posterior, path: Path) -> None:
    """Write groups ``posterior``, ``sample_stats`` (of a chain), ``posterior_predictive`` and ``observed_data``.

    Parameter groups are one variable ``parameter`` over their ids, in mm, rad and derived units; each hyperparameter is
    a variable, with dots in its name replaced by underscores.
    """
    import h5netcdf

    chains, draws = posterior.values.shape[:2]
    sizes = {"chain": chains, "draw": draws, "group": len(posterior.names)}
    library = "emcee" if posterior.method == "emcee" else "errormodel"
    attributes = {"inference_library": library, "creation_library": "errormodel", "creation_version": __version__}
    own: dict[str, tuple[tuple[str, ...], Array, str]] = {
        "parameter": (("chain", "draw", "group"), posterior.values, "mm, rad and what is made of them")
    }
    for k, unknown in enumerate(posterior.unknowns):
        name = unknown.name.replace(".", "_").replace("-", "_")
        own[name] = (("chain", "draw"), posterior.coordinates[:, :, k], unknown.unit)
    with replacing(path) as part, h5netcdf.File(part, "w") as file:
        _group(file, "posterior", sizes, own, {**attributes, "statement": posterior.statement}, posterior.names)
        if posterior.chains is not None:
            log_prob = posterior.chains.log_prob[:, :: -(-posterior.chains.log_prob.shape[1] // draws)]
            stats = {"lp": (("chain", "draw"), log_prob, "nats")}
            _group(file, "sample_stats", {"chain": chains, "draw": draws}, stats, attributes)
        if posterior.checks:
            count = {"chain": 1, "draw": len(posterior.checks[0].replicated)}
            figures = {c.name: (("chain", "draw"), c.replicated[None], "1") for c in posterior.checks}
            _group(file, "posterior_predictive", count, figures, attributes)
        seen = {"residual": (("row", "axis"), fit.residuals, "mm")}
        _group(file, "observed_data", {"row": len(fit.residuals), "axis": 3}, seen, attributes)


def _group(
    file: Any,
    name: str,
    sizes: Mapping[str, int],
    variables: Mapping[str, tuple[tuple[str, ...], Array, str]],
    attributes: Mapping[str, str],
    groups: Sequence[str] = (),
) -> None:
    """Write one group with its dimensions, variables and attributes."""
    import h5py

    group = file.create_group(name)
    group.dimensions = dict(sizes)
    for key, value in attributes.items():
        group.attrs[key] = value
    for key, size in sizes.items():
        if key == "group":
            labels = group.create_variable(key, (key,), dtype=h5py.string_dtype())
            labels[...] = np.array(groups, dtype=object)
        else:
            group.create_variable(key, (key,), data=np.arange(size))
    for key, (dimensions, values, unit) in variables.items():
        variable = group.create_variable(key, dimensions, data=np.ascontiguousarray(values))
        variable.attrs["units"] = unit
