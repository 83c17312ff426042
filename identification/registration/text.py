"""Lines that `register` prints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.conventions import MOTIONS, iso_symbol, unit_of
from identification.registration.register import Registered
from identification.results.parameter_table import printed


def register_lines(result: Registered) -> Iterator[str]:
    """Lines about the mount, and for each run the fit of the clouds and the size of the error motions."""
    table, mount = result.table, result.mount
    std = np.sqrt(np.diag(mount.covariance))
    yield "mount of the sensor in the tool frame"
    for name, value, u in zip(("x", "y", "z"), mount.six[:3], std[:3], strict=True):
        yield f"  {name:6}{value:12.4f} +- {u:.4f} mm"
    for name, value, u in zip(("alpha", "beta", "gamma"), mount.six[3:], std[3:], strict=True):
        yield f"  {name:6}{1e3 * value:12.4f} +- {1e3 * u:.4f} mrad"
    if mount.stacked:
        yield "  the clouds are profiles stacked along the machine's travel; they are taken into the sensor's frame"
    joint = str(table["joint"].iloc[0])
    names = "".join(f"{iso_symbol(joint, m):>10}" for m in MOTIONS)
    yield f"\n{'largest of each run, um and urad':34}{names}{'rmse um':>10}"
    for run, rows in table.groupby("run", sort=False):
        largest = [rows[m].iloc[int(rows[m].abs().argmax())] for m in MOTIONS]
        cells = "".join(f"{printed(unit_of(m))[0] * v:10.2f}" for m, v in zip(MOTIONS, largest, strict=True))
        yield f"  {str(run)[:32]:32}{cells}{1e3 * rows['rmse'].mean():10.3f}"
    typical = [printed(unit_of(m))[0] * float(np.median(table[f"u_{m}"])) for m in MOTIONS]
    yield f"  {'standard uncertainty (median)':32}" + "".join(f"{u:10.2f}" for u in typical)
