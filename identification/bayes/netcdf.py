"""Posterior draws as a netCDF-4 file that ``arviz.from_netcdf`` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from errormodel import __version__
from errormodel.arrays import Array
from errormodel.extras import optional
from errormodel.files import replacing
from identification.bayes.posterior import Posterior
from identification.estimation.result import Fit

if TYPE_CHECKING:
    from xarray import DataTree

Labels: TypeAlias = Mapping[str, range | Sequence[str]]  # of each dimension


def write_netcdf(fit: Fit, posterior: Posterior, path: Path) -> None:
    """Write what ArviZ knows: ``posterior``, ``prior``, ``log_likelihood``, ``observed_data`` and others.

    Groups ``sample_stats`` (of a chain) and ``posterior_predictive`` are there where they are known. Parameters are one
    variable ``parameter`` over their ids; what is not linear has a variable each, dots in its name becoming
    underscores. The log-likelihood has a variable for each kind of observation, over the survey's rows.
    """
    from io import BytesIO

    import h5netcdf

    p = posterior
    chains, draws = p.values.shape[:2]
    library = "emcee" if p.method == "emcee" else "errormodel"
    attributes = {"inference_library": library, "creation_library": "errormodel", "creation_version": __version__}
    made = BytesIO()  # HDF5 breaks down, with the process, where a disk is full
    with h5netcdf.File(made, "w") as file:
        sizes: Labels = {"chain": range(chains), "draw": range(draws), "group": p.names}
        own = _variables(p, p.values, p.coordinates)
        _group(file, "posterior", sizes, own, {**attributes, "statement": p.statement})
        before: Labels = {"chain": range(1), "draw": range(len(p.prior_values)), "group": p.names}
        own = _variables(p, p.prior_values[None], p.prior_coordinates[None])
        _group(file, "prior", before, own, attributes)
        if p.log_likelihood:
            some: Labels = {"chain": range(chains), "draw": range(0, draws, p.every), "row": range(len(fit.survey))}
            logs = {kind: (("chain", "draw", "row"), log, "1") for kind, log in p.log_likelihood.items()}
            _group(file, "log_likelihood", some, logs, attributes)
        if p.chains is not None:
            log_prob = p.chains.log_prob[:, :: -(-p.chains.log_prob.shape[1] // draws)]
            stats = {"lp": (("chain", "draw"), log_prob, "1")}
            _group(file, "sample_stats", {"chain": range(chains), "draw": range(draws)}, stats, attributes)
        if p.checks:
            count = {"chain": range(1), "draw": range(len(p.checks[0].replicated))}
            figures = {c.name: (("chain", "draw"), c.replicated[None], "1") for c in p.checks}
            _group(file, "posterior_predictive", count, figures, attributes)
        seen = {"residual": (("row", "axis"), fit.residuals, "mm")}
        _group(file, "observed_data", {"row": range(len(fit.residuals)), "axis": range(3)}, seen, attributes)
    with replacing(path) as part:
        part.write_bytes(made.getbuffer())


def as_tree(fit: Fit, posterior: Posterior) -> DataTree:
    """The same in memory, as ArviZ takes it.

    Raises
    ------
    InputError
        xarray, which ArviZ stands on, is not installed.
    """
    import tempfile

    open_datatree = optional(
        "xarray", "posterior", "an xarray.DataTree", "read posterior.nc, which `save` writes"
    ).open_datatree
    with tempfile.TemporaryDirectory() as folder:
        write_netcdf(fit, posterior, Path(folder) / "posterior.nc")
        with open_datatree(Path(folder) / "posterior.nc", engine="h5netcdf") as tree:
            loaded: DataTree = tree.load()
            return loaded


def _variables(
    posterior: Posterior, values: Array, coordinates: Array
) -> dict[str, tuple[tuple[str, ...], Array, str]]:
    """Parameters (chains, draws, p) and coordinates (chains, draws, q) by the names of their variables."""
    out: dict[str, tuple[tuple[str, ...], Array, str]] = {
        "parameter": (("chain", "draw", "group"), values, "mm, rad and what is made of them")
    }
    for k, unknown in enumerate(posterior.unknowns):
        name = unknown.name.replace(".", "_").replace("-", "_")
        out[name] = (("chain", "draw"), coordinates[:, :, k], unknown.unit)
    return out


def _group(
    file: Any,
    name: str,
    labels: Labels,
    variables: Mapping[str, tuple[tuple[str, ...], Array, str]],
    attributes: Mapping[str, str],
) -> None:
    """Write one group with its dimensions, variables and attributes."""
    import h5py

    group = file.create_group(name)
    group.dimensions = {key: len(own) for key, own in labels.items()}
    for key, value in attributes.items():
        group.attrs[key] = value
    for key, own in labels.items():
        if isinstance(own, range):
            group.create_variable(key, (key,), data=np.array(own))
        else:
            words = group.create_variable(key, (key,), dtype=h5py.string_dtype())
            words[...] = np.array(own, dtype=object)
    for key, (dimensions, values, unit) in variables.items():
        variable = group.create_variable(key, dimensions, data=np.ascontiguousarray(values))
        variable.attrs["units"] = unit
