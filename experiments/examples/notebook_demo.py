"""The demo as a notebook of cells (`# %%`): simulate, tune and look, on a built-in machine."""

from jcontour.app import StoredRun, main

# %% A part on a machine; the command prints its screen and writes a run folder
main(["simulate", "square", "--out", "demo/first"])

# %% Tune for it; more --steps, --starts and --scatter find more
few = ["--steps", "3", "--starts", "1", "--scatter", "0"]
main(["tune", "square", *few, "--out", "demo/tuned"])

# %% A run as an object: the last expression of a cell shows the screen again
tuned = StoredRun("demo/tuned")
tuned

# %% Its numbers, SI: the worst machine of the family on every contour
for contour in tuned.result.contours:
    before, after = (contour.metrics[name].worst for name in (contour.compared, "tuned"))
    change = f"{1e6 * before.rms_contour_error:.2f} -> {1e6 * after.rms_contour_error:.2f} um"
    print(f"{contour.name:<12} {'training' if contour.training else 'held out'}  {change}")
