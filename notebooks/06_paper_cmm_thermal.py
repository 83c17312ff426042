# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # "Synthesization of Thermally Induced Errors in Coordinate Measuring Machines"
#
# The paper measures the 21 errors of a moving-bridge CMM at 20 °C, records how they drift at four positions an axis
# while the room goes to 26 °C and back, regresses each drift on thermocouples, and compensates a ring gauge with that.
# Its recordings are not published. Here its equations are checked against the chain of `bridge_cmm`; its experiment is
# done again on a simulated machine, with a simulator that shares no code with the tool; its method and
# `errormodel thermal` are judged on another thermal cycle; and its tables are checked against each other.

# %%
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt  # so that Jupyter shows figures

from errormodel import library, read_machine, simulate
from errormodel.arrays import as_rows
from errormodel.chain import Chain  # its exact derivatives stand beside the paper's equations
from identification import thermal
from identification.uncertainty.budget import Input, combine  # for the paper's own budget, line by line

ROOT = library()["bridge_cmm"].parents[1]
sys.path.insert(0, str(ROOT))  # the simulator is among the tests
from tests.helpers import thermal_cmm as cmm
from tests.helpers.ring_gauge import SURVEY, ring_errors

machine = read_machine("bridge_cmm")

# %% [markdown]
# ## Equations (1) to (3) and (16) to (18)
#
# Each is a sum of error motions, each times a lever. Below, the lever that the chain gives to every motion, by
# differentiation of its exact kinematics, beside the one that is printed. X23, Y34, Z12 and Z45 are distances in the
# paper (the carriage stands behind the bridge, the probe below), and its Z counts downwards. (1) to (3) are the errors
# at 20 °C; in (16) to (18) every error has its thermal variation beside it, so that levers are what can be compared.

# %%
OFFSETS = {"X23": -60.0, "Y34": 110.0, "Z12": 560.0, "Z45": 200.0}  # mm, of bridge_cmm
MOTIONS = {
    "Pos_X": "X.dx.1", "Rx_Y": "X.dy.1", "Rx_Z": "X.dz.1", "Roll_X": "X.ea.1", "Pitch_X": "X.eb.1", "Yaw_X": "X.ec.1",
    "Ry_X": "Y.dx.1", "Pos_Y": "Y.dy.1", "Ry_Z": "Y.dz.1", "Pitch_Y": "Y.ea.1", "Roll_Y": "Y.eb.1", "Yaw_Y": "Y.ec.1",
    "Rz_X": "Z.dx.1", "Rz_Y": "Z.dy.1", "Pos_Z": "Z.dz.1", "Pitch_Z": "Z.ea.1", "Yaw_Z": "Z.eb.1",
    "Ort_XY": "bridge.ec", "Ort_XZ": "carriage.eb", "Ort_YZ": "carriage.ea",
}  # fmt: skip
BELOW = "-Z - Z45"
PRINTED = {
    "(1)": {"Pos_X": "1", "Ry_X": "1", "Rz_X": "1", "Ort_XY": "Y34", "Yaw_X": "Y34", "Ort_XZ": BELOW, "Pitch_X": BELOW,
            "Yaw_Z": BELOW, "Roll_Y": f"{BELOW} + Z12"},
    "(2)": {"Pos_Y": "1", "Rx_Y": "1", "Rz_Y": "1", "Ort_XY": "X23 + X", "Yaw_Y": "X23 + X",
            "Pitch_Y": "-Z12 + 2*(Z - Z45)", "Ort_YZ": "Z - Z45", "Roll_Y": "Z - Z45"},
    "(3)": {"Pos_Z": "1", "Rx_Z": "1", "Ry_Z": "1", "Roll_Y": "-(X23 + X)", "Roll_X": "-Y34", "Pitch_Y": "-Y34"},
    "(16)": {"Pos_X": "1", "Ry_X": "1", "Rz_X": "1", "Ort_XY": "Y34", "Yaw_X": "Y34", "Ort_XZ": BELOW, "Pitch_X": BELOW,
             "Yaw_Z": BELOW, "Roll_Y": f"{BELOW} + Z12"},
    "(17)": {"Pos_Y": "1", "Rx_Y": "1", "Rz_Y": "1", "Ort_XY": "X23 + X", "Yaw_Y": "X23 + X",
             "Pitch_Y": "-Z12 - (-Z - Z45)", "Ort_YZ": "-(-Z - Z45)", "Roll_X": "-(-Z - Z45)",
             "Pitch_Z": "-(-Z - Z45)"},
    "(18)": {"Pos_Z": "1", "Rx_Z": "1", "Ry_Z": "1", "Roll_Y": "-(X23 + X)", "Roll_X": "-Y34", "Pitch_Y": "-Y34"},
}  # fmt: skip

chain = Chain(machine)
points = simulate(machine, 500, seed=3)  # a machine without rotary joints: mm throughout
rows = as_rows(*(points[c].to_numpy() for c in chain.channels))
ids = tuple(MOTIONS.values())
design = chain.kernel("design", ids, outputs=(0, 1, 2))(rows).reshape(len(ids), 3, -1)
terms = chain.kernel("terms", ids)(rows).reshape(-1, 6, len(points))[: len(ids)]
own = np.where(np.abs(terms).max(axis=1) > 0, terms.sum(axis=1), 1.0)  # the motion itself: what remains is the lever
levers = dict(zip(MOTIONS, design / own[:, None], strict=True))
lengths = {**OFFSETS, "X": points["X"].to_numpy(), "Z": -points["Z"].to_numpy()}


def lever(text: str) -> np.ndarray:
    """The value (n,) of a lever as printed."""
    return np.broadcast_to(eval(text, {"__builtins__": {}}, lengths), len(points))


# what a lever of the chain may be made of, to say it as the paper would
WORDS = ["1", "Y34", "-Y34", BELOW, f"{BELOW} + Z12", "-(-Z - Z45)", "-Z12 - (-Z - Z45)", "X23 + X", "-(X23 + X)", "X",
         "-Z45", "Z45"]  # fmt: skip
different = {}
for equation, printed in PRINTED.items():
    axis = (int(equation.strip("()")) - 1) % 3
    for name in MOTIONS:
        ours, theirs = levers[name][axis], lever(printed.get(name, "0"))
        if not np.allclose(ours, theirs, atol=1e-9):
            said = next((w for w in ["0", *WORDS] if np.allclose(ours, lever(w), atol=1e-9)), "?")
            different[equation, name] = said
            print(f"{equation:5} {name:8} printed: {printed.get(name, 'nothing'):18} chain: {said}")
agreed = sum(len(p) for p in PRINTED.values()) - sum(n in PRINTED[e] for e, n in different)
print(f"{agreed} of {sum(map(len, PRINTED.values()))} printed terms agree")
assert "?" not in different.values()

# %% [markdown]
# - **Eq. (2) is misprinted.** Its last bracket, [Ort_YZ + Roll_Y + Pitch_Y + Pitch_Y]·(Z - Z45), should be that of
#   (17), [Ort_YZ + Roll_X + Pitch_Y + Pitch_Z], with -(-Z - Z45) = Z + Z45: a roll about Y moves nothing along Y.
# - **Eq. (17)** prints Pitch_Y·δ[Pitch_Y] where the sum is meant, as everywhere else.
# - **Yaw_Y·Y34 is missing** from (1) and (16): the bridge that yaws takes the carriage along, which stands Y34 behind
#   it. With the paper's 7 arcsec, and 110 mm, that is 3.7 µm at Y = 350 mm: more than any residual that it reports.
# - **Yaw_Z and Pitch_Z** have the lever Z + Z45 in print and Z45 in the chain. The chain takes error motions at the
#   carriage, as the contract of the tool says, so that only what hangs below it is a lever; in print the ram turns
#   before it slides. Either is right with straightness measured at the same point, and wrong with the other's.
# - **Ort_XY** acts on X in the chain and on X23 + X in print: the difference is a constant, which the zero takes up.
# - Ort_XZ, Ort_YZ, Roll_Y, Pitch_X, all of (3) and (18): as printed.
# - The paper lets offsets drift too (δY34 ...). For 110 mm of aluminium, 6 K and 7 arcsec this is half a nanometre:

# %%
print(f"delta Y34 * Yaw = {1e6 * 23e-6 * 110 * 6 * np.radians(7 / 3600):.2f} nm; Yaw_Y * Y34 = "
      f"{1e3 * 110 * np.radians(7 / 3600):.1f} um")  # fmt: skip
assert set(different) == {
    ("(1)", "Yaw_Y"), ("(1)", "Yaw_Z"), ("(16)", "Yaw_Y"), ("(16)", "Yaw_Z"), ("(2)", "Ort_XY"), ("(2)", "Ort_YZ"),
    ("(2)", "Pitch_Y"), ("(2)", "Pitch_Z"), ("(2)", "Roll_X"), ("(2)", "Roll_Y"), ("(17)", "Ort_XY"),
    ("(17)", "Pitch_Z"),
}  # fmt: skip

# %% [markdown]
# ## Drift recordings, and another cycle
#
# The simulated room goes to 26 °C and back in 2 x 3 h 10 min, with the paper's gradients on the left and on the right,
# a heater that comes and goes, a draught, and somebody who stands there at times. Members have a skin, which the 18
# thermocouples see (late, with noise of 0.03 K, in the steps of 12 bits), and a core, which expands. Four recordings an
# axis, one position and one cycle each. For the judgement: one more cycle an axis, which goes to 23.5, 26.5 and
# 22 °C, at three positions where nothing was recorded. Noise as in the paper: 0.17 µm for one reading of a position
# (0.074 µm is the mean of five), 0.5 µm for straightness, 0.1 arcsec.

# %%
SEED = 1
drift = cmm.drift_recordings(SEED)
part = drift[drift["run"] == "Y300"]
hours = (part["time"] - part["time"].min()) / 3600
figure, axes = plt.subplots(1, 3, figsize=(10, 3), layout="constrained")
for name in ("T_1", "T_4", "T_5", "T_8", "T_17", "T_18"):
    axes[0].plot(hours, part[name], lw=1, label=name)
for _, own in drift[drift["joint"] == "Y"].groupby("run", sort=False):
    axes[1].plot(hours, 1e3 * own["dy"], lw=1, label=f"Y = {own['Y'].iloc[0]:.0f} mm")
    axes[2].plot(hours, 1e6 * own["ec"], lw=1)
axes[0].legend(ncols=2, fontsize=7)
axes[1].legend(fontsize=7)
for ax, label in zip(axes, ("temperature / °C", "EYY / µm", "ECY / µrad"), strict=True):
    ax.set(xlabel="hours", ylabel=label)

# %% [markdown]
# ## Regression as in the paper, and temperatures behind lags
#
# `errormodel thermal bridge_cmm SURVEY --out thermal` does both, and judges both by the other cycle. *Regression*
# is the paper's: sensors that correlate at 0.999 are one, stepwise selection at each position (Eq. 5), the polynomial
# through the four positions (Eqs. 6 to 8). *Lagged* are a few temperatures behind first-order lags, found one by one by
# what they predict in stretches and recordings that were left out, tied to zero by a prior.

# %%
with tempfile.TemporaryDirectory() as folder:
    cycles = {"at_20": cmm.calibration(SEED), "drift": drift, "other": cmm.other_cycle(SEED)}
    for name, table in cycles.items():
        table.to_csv(Path(folder) / f"{name}.csv", index=False)
    (Path(folder) / "survey.yaml").write_text(SURVEY)
    model = thermal(machine, folder)
print(model.summary())
result = model.thermal
by_regression, by_lags = result.left_beyond
assert by_lags < 0.6 * by_regression
model.plot.drift()

# %% [markdown]
# The regressions are praised by R² on the very data that they were fitted to (99.7 % and more in the paper; here, where
# the drift is large). On another cycle the figure says little: the worst of them, by its R² and by what it misses,

# %%
for m in sorted(result.motions, key=lambda m: m.noise / m.stepwise)[:4]:
    print(f"{m.symbol}: R^2 {100 * m.stepwise_r2:.2f} %, misses the other cycle by {m.stepwise / m.noise:.1f} times "
          f"the noise, with lags by {m.lagged / m.noise:.1f} times")  # fmt: skip

# %% [markdown]
# The printed coefficients show the same sickness. They are tens of µm/K, with both signs, and nearly cancel: what a
# uniform kelvin does is their sum, while independent errors of the thermocouples enter by the root of their squares.
# (12) has two coefficients without a decimal point, 1830·T4 and 14400·T7, which would be 11 and 86 mm in 6 K. With
# 18.30 and 14.400:

# %%
PRINTED_COEFFICIENTS = {
    "(9) EYY at 0": [-3.50, 19.60, -14.00, -8.50, 8.76, 3.20, -1.20, -2.30, 7.38, -3.00, -2.10, 2.90, -5.50, -2.30],
    "(10) EYY at 75": [11.70, -1.70, 2.75, -7.10, -3.80, 0.87, -0.97, -0.85, 1.46, -1.80, -1.70, -2.70, -4.70],
    "(11) EYY at 200": [12.30, -1.80, -3.80, -1.90, 1.35, -3.40, -2.40, -1.30],
    "(12) EYY at 300": [4.02, 5.03, 1.79, 18.30, -5.20, 14.40, -9.10, 1.74, -1.80, -5.50, -1.30, 3.75, 1.80],
    "(14) EXY": [-21.00, 6.88, 12.80, -6.40, -4.00, -1.80, 2.52, -6.50, 10.20, 2.37, 5.36],
    "(15) ECY": [2.81, -21.0, 9.18, 8.99, 3.37, -7.30, -2.50, 1.35, 1.90, -3.30, 1.53, 2.80, 5.01, 3.00, 0.57],
}
for name, values in PRINTED_COEFFICIENTS.items():
    unit = "arcsec" if "ECY" in name else "um"
    print(f"{name:16} uniform kelvin: {sum(values):6.2f} {unit}; 0.1 K of noise in each sensor: "
          f"{0.1 * np.linalg.norm(values):.1f} {unit}")  # fmt: skip

# %% [markdown]
# Then a uniform kelvin moves 300 mm by +28 µm and 75 mm by -9 µm: 160 ppm/K, seven times aluminium. Two decimals, as
# all others have (144.00), would make it worse: what is meant cannot be told. Of 28 thermocouples Eq. (5) has 18, of
# which T1 to T17 appear.
#
# ## The ring gauge
#
# 11 random points on a ring of 180.0124 mm at eight places, where nothing had been measured, at 20 and at 26 °C. The
# ring is of steel and follows the air in 40 minutes: what is wanted at 26 °C is the diameter that it has there, 9 to
# 11 µm more than at 20 °C. The readings are corrected by what `predict` says of each, with the temperatures since the
# warm-up began; or, as the paper does it, by the same geometry and the regressions.

# %%
ring = pd.concat([ring_errors(result, SEED, level) for level in (0.0, 6.0)], ignore_index=True)
print(ring.round(2).to_string(index=False))
for name in ("regressions", "lags"):
    removed = 1 - (ring[name] / ring["measured"]).abs()
    print(f"{name}: at least {100 * removed.min():.1f} % removed, in the mean {100 * removed.mean():.1f} %")
assert removed.min() > 0.95

# %% [markdown]
# The regressions do what the paper says of them (90 % and more), and the lagged temperatures the rest.
#
# One seed is luck. `python -m tests.benchmarks.thermal_cmm` does all of this for ten that nothing was tried on: in the
# other cycle regressions leave 1.23 times the noise, beyond it, and lagged temperatures 0.36. Of the ring's errors
# regressions remove 97.1 % in the mean and 85.3 % at worst, lagged temperatures 98.9 % and 94.7 %, over 160 rings. With
# `parts` it takes away what the method is made of: without lags 0.86 times the noise is left, without the prior 0.74,
# without both 0.99 (three seeds, on which all of it leaves 0.37 and regressions 1.16).

# %% [markdown]
# The paper explains that errors are smaller in the middle of the plate by the scales, which are held near their middle.
# That cannot be the reason for a diameter: where a scale is held shifts the ring, and its size stays what it was.

# %%
turn = 2 * np.pi * np.arange(11) / 11
circle = np.column_stack([90 * np.cos(turn), 90 * np.sin(turn), 0 * turn])
sizes = []
for held in (0.0, 175.0, 350.0):
    grown = circle + np.array([175.0, 200.0, 0.0])
    grown[:, 0] += 17e-6 * 6 * (grown[:, 0] - held)
    sizes.append(1e3 * (cmm.diameter(grown) - 180))
print("diameter when X expands by 102 ppm, held at 0, 175, 350 mm:", *(f"{s:.2f} um" for s in sizes))
assert max(sizes) - min(sizes) < 1e-3

# %% [markdown]
# ## Tables 1 to 3 against each other

# %%
TABLE_1 = [(180.000, 180.0126, 0.60, 94.96), (180.003, 180.0143, 2.26, 74.85), (179.996, 180.0115, -0.52, 96.74),
           (179.999, 180.0136, 1.59, 87.77)]  # fmt: skip
TABLE_2 = [
    (179.982, 180.0119, -1.81, 94.28), (179.982, 180.0107, -2.96, 90.66), (179.980, 180.0116, -2.11, 93.72),
    (179.986, 180.0117, -2.02, 92.71), (180.004, 180.0112, -2.49, 74.26), (179.997, 180.0149, 1.17, 92.98),
    (179.999, 180.0129, -0.76, 94.80), (180.001, 180.0140, 0.34, 97.26),
]  # fmt: skip
for name, table, said in (("1", TABLE_1, 180.0124), ("2", TABLE_2, 180.0137)):
    standard = np.array([modelled - 1e-3 * residual for _, modelled, residual, _ in table])
    print(
        f"Table {name}: its residuals are against {standard.mean():.5f} +- {standard.std():.5f} mm; the text has {said}"
    )
    for measured, _, residual, percent in table:
        assert abs(100 * (1 - 1e-3 * abs(residual) / (standard.mean() - measured)) - percent) < 0.15
spread = [np.std([row[k] for row in TABLE_1], ddof=1) * 1e3 for k in (0, 1)]
print(f"standard deviation in Table 1: {spread[0]:.2f} -> {spread[1]:.2f} um; the text has 2.8 -> 1.6")
low = [(round(1e3 * (ref - m)), p) for t, ref in ((TABLE_1, 180.012), (TABLE_2, 180.0137)) for m, _, _, p in t]
print("errors of 10 um and more with less than 90 %:", [pair for pair in low if pair[0] >= 10 and pair[1] < 90])
print("smaller errors with less than 75 %:", [pair for pair in low if pair[0] < 10.5 and pair[1] < 75])
print(f"the ring grows by {1e6 * (180.0137 - 180.0124) / 180 / 6:.1f} ppm/K; steel by 11.5")
drifts = [(12, 32, 20), (9, 32, 23), (16, 34, 18), (13, 28, 15), (9, 16, 7)]  # Table 3
assert all(warm - cold == drift for cold, warm, drift in drifts)

# %% [markdown]
# ## Table 4: the budget of the position of X at 275 mm

# %%
LINES = [
    Input("M", "A", "normal", 0.074, "um", 1.0, 4.0),
    Input("R_MM3C", "B", "rectangular", 1.15e-6, "um", 1.0),
    Input("R_laser", "B", "rectangular", 0.0058, "um", 1.0),
    Input("alpha_E", "B", "rectangular", 1.95e-10, "um", 1.0),  # as the table has them: already as contributions
    Input("C_laser", "B", "rectangular", 5.17e-7, "um", 1.0),
    Input("delta T", "B", "rectangular", 1.07e-8, "um", 1.0),
    Input("Delta T", "B", "rectangular", 5.17e-5, "um", 1.0),
]
budget = combine("position of X at 275 mm", "um", LINES)
print(f"from its lines: u = {budget.std:.4f} um, {budget.dof:.2f} degrees of freedom, k = {budget.k:.2f}, "
      f"U = {budget.expanded:.3f} um")  # fmt: skip
print("printed:        u = 0.104 um,  4.05 degrees of freedom, k = 2.78, U = 0.289 um")
twice = combine("M twice", "um", [*LINES, LINES[0]])
print(f"M counted twice: u = {twice.std:.4f} um, {twice.dof:.2f} degrees of freedom, U = {twice.expanded:.3f} um")
assert abs(budget.dof - 4.05) < 0.005
assert abs(budget.k - 2.78) < 0.005
assert abs(2.78 * 0.104 - 0.289) < 5e-4  # the printed U is that of the printed u
assert abs(twice.std - 0.104) < 1e-3

# %% [markdown]
# - The printed 4.05 degrees of freedom and k = 2.78 are those of the lines (u = 0.074 µm). The printed u = 0.104 µm is
#   not: it is √2 x 0.074, as if the repeatability came in twice; with it there would be 8 degrees of freedom. The lines
#   give U = 0.206 µm; the printed 0.289 µm is 2.78 x 0.104.
# - Degrees of freedom of C_laser are printed as 8: the sign ∞ on its side. It changes nothing.
# - The signs of the last column belong to the sensitivities: a standard uncertainty has none.
# - A position at 275 mm on a scale of 11 ppm/K moves by 3 µm a kelvin. The table's sensitivities to temperature are
#   5e-8 and 1.4e-5 µm/K, so that no thermometer could matter. With 0.1 K, which is good, the budget is another one:

# %%
expansion = 11.5e-6 * 275e3  # um/K
thermometer = Input("0.1 K", "B", "rectangular", 0.1 / 3**0.5, "K", expansion)
real = combine("with the scale's own expansion", "um", [*LINES, thermometer])
share = (thermometer.contribution / real.std) ** 2
print(f"u = {real.std:.3f} um, U = {real.expanded:.2f} um; {100 * share:.0f} % of the variance from the thermometer")

# %% [markdown]
# ## What the print says, and what comes out
#
# | the paper | here |
# |---|---|
# | Eqs. (1) to (3) and (16) to (18) | follow from the chain but for the terms above; of (2) and (17), (17) is right |
# | Yaw_Y·Y34 left out | 3.7 µm at 350 mm: belongs into (1) and (16) |
# | R² of 99.7 % and more | says little of another cycle: judge there |
# | stepwise regression at four positions | misses another cycle by more than lagged temperatures do |
# | errors over 10 µm reduced by 90 %, others by 75 % | Table 1: 87.8 % of 13 µm, 74.9 % of 9; Table 2: 74.3 % of 9.7 |
# | "greater than 7.4 %" at positions 5 to 8 | 74 %: the point has slipped |
# | ring of 181.0124 mm at 20 °C | 180.0124; the residuals at 20 °C are against 180.0120 |
# | ring of 180.0137 mm at 26 °C | 1.2 ppm/K: no steel; if it is of steel, 11 µm are missing there |
# | standard deviation 1.6 µm after compensation at 20 °C | 1.22 µm from Table 1 |
# | smaller at the middle, as scales are held there | cannot be: a diameter does not feel where a scale is held |
# | Table 4: u = 0.104 µm, U = 0.289 µm | 0.074 and 0.206 µm from its own lines and degrees of freedom |

# %%
plt.close("all")
