"""My machine as a notebook: identify it from a log, simulate a part on it, draw the errors."""

from jcontour.app import StoredRun, main

# %% Your log in place of --demo: time, the command and the measured position of every axis
main(["identify", "--demo", "--most-order", "1", "--most-delay", "4", "--out", "mill"])

# %% Put the limits of your machine into mill/machine.json, then look at it
main(["machine", "mill/machine.json"])

# %% A part on the family of machines that the log allows
main(["simulate", "circle", "--plant", "mill/machine.json", "--out", "part"])
part = StoredRun("part")
part

# %% What every machine of the family makes of it
for plant, metrics in part.result.plants.items():
    print(f"{plant:<24} RMS contour error {1e6 * metrics.rms_contour_error:.2f} um")

# %% Next: main(["tune", "part.ngc", "--plant", "mill/machine.json"])
