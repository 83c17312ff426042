# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # From commands to a fitted machine
#
# A five-axis machining centre: table B turns, X, Z and Y carry the spindle, the quill W moves along Z once more. Its
# survey is the demonstration that comes with the tool: simulated, so that its errors are known
# (`00_demonstration_data.py`). The same steps on the command line are `errormodel describe`, `fit` and `predict`.
#
# As a script, this notebook shows nothing but its numbers. With `--write` it replaces the figures in `figures/`, which
# the README shows.

# %%
import sys
import tempfile

import numpy as np
from matplotlib import pyplot as plt  # so that Jupyter shows figures
from ruamel.yaml import YAML

from errormodel import library, read_machine, read_survey
from identification import describe, fit, load, save

MACHINES = library()["five_axis_table_quill"].parent  # the folder that also holds the examples
EXAMPLE = MACHINES / "examples" / "five_axis_table_quill"
machine = read_machine("five_axis_table_quill")

# %% [markdown]
# ## What is commanded
#
# Each row commands five joints and names the functional point of its tool. What is measured is that point in the frame
# of a laser tracker, which stands where it stands.

# %%
survey = read_survey(EXAMPLE / "survey.yaml", machine)
survey.table.groupby(["file", "role", "run", "tool_z"], sort=False).size().rename("rows").reset_index()

# %% [markdown]
# ## What can be known before anything is fitted
#
# The model has 52 parameters. Three move nothing that is measured. The rest act in 32 independent ways if one tool is
# used. Two tools of different lengths take two of those groups apart: 34.

# %%
one_tool, this_survey = describe(machine), describe(machine, survey)
print(f"one tool: rank {one_tool.groups.rank}; this survey: rank {this_survey.groups.rank}")
print(this_survey.summary())

# %% [markdown]
# ## The fit
#
# The measuring frame, of any size, and all groups together, weighted by the tracker's uncertainty at each point.
# `held out` are rows predicted by a fit that did not see them, ten blocks of consecutive rows in turn. The file
# `check.csv` is not fitted at all: other poses, a third tool, nothing estimated from it.

# %%
result = fit(machine, survey)
print(result.summary())

# %%
errors = result.plot.errors()
errors

# %%
result.plot.distribution()

# %% [markdown]
# The error motions of the vertical axis. A fit tells only what its groups hold: constants and slopes that a member or
# the measuring frame can take are theirs.

# %%
result.plot.motions("Y")

# %% [markdown]
# ## Against the truth
#
# The machine was simulated with values for all 52 parameters. A fit returns groups, so the truth is summed by the same
# coefficients. Groups that hold the measuring frame are left out: the frame that the tool took is not that of the file.

# %%
truth = YAML(typ="safe").load(EXAMPLE / "truth.yaml")["parameters"]
compared = result.parameters.reset_index()
compared = compared[[not any(member.startswith("frame") for member in m) for m in compared["members"]]]
compared = compared.assign(
    true=[sum(coefficient * truth[member] for member, coefficient in m.items()) for m in compared["members"]]
)[["id", "true", "value", "std", "unit"]]
compared["off by std"] = (compared["value"] - compared["true"]) / compared["std"]
print(compared.to_string(index=False, float_format="{:.3g}".format))

# %% [markdown]
# Estimates scatter about the truth as their covariance says: the chi-square of their differences is near the number of
# groups.

# %%
difference = (compared["value"] - compared["true"]).to_numpy()
covariance = result.covariance.loc[compared["id"], compared["id"]].to_numpy()
size = np.sqrt(np.diag(covariance))
chi2 = float((difference / size) @ np.linalg.solve(covariance / np.outer(size, size), difference / size))
print(f"chi-square {chi2:.1f} for {len(compared)} groups")
assert 12 < chi2 < 60

# %% [markdown]
# ## A prediction
#
# From the folder of a fit, for commands that need no measurement. `e` is the volumetric error, actual minus nominal
# after the best-fit frame; `u` is the model's own standard uncertainty, without the noise of a measurement.

# %%
with tempfile.TemporaryDirectory() as folder:
    save(result, folder)
    commands = read_survey(EXAMPLE / "check.csv", machine, measured=False)
    predicted = load(folder).predict(commands)[["mx", "my", "mz", "ex", "ey", "ez", "ux", "uy", "uz"]]
print(predicted.head().to_string(float_format="{:.4f}".format))
missed = 1e3 * (commands.measured - predicted[["mx", "my", "mz"]].to_numpy())
print(f"check.csv: predicted within {np.sqrt((missed**2).sum(axis=1).mean()):.2f} um rms")
assert np.isclose(np.sqrt((missed**2).sum(axis=1).mean()), result.statistics.loc["test check.csv", "rms_um"], atol=1e-6)

# %%
if "--write" in sys.argv:
    errors.savefig(MACHINES.parent / "notebooks" / "figures" / "five_axis_errors.png", dpi=150)
plt.close("all")
