"""The windings of a linear motor from a recorded test: parameters with 95 % intervals."""

from jcontour.plants import thesis_axis, thesis_motor
from tuning.identification.flexible_axis.commissioning import Commissioning
from tuning.identification.flexible_axis.winding import fit_winding

# Your own test goes here: Record("electrical", dt, motor=..., current=..., voltage=..., ...).
# This one is simulated, with quantised encoders and noise on the current; the current steps to
# and fro in an open loop.
record = Commissioning(thesis_axis(), thesis_motor(), seed=3).electrical()

# u = R i + L di/dt + k_e v, fitted by simulating the current from voltage and speed alone.
estimate = fit_winding([record]).estimate
units = {"resistance": "ohm", "inductance": "H", "back_emf": "V s/m"}
for name, unit in units.items():
    low, high = estimate.interval(name)
    print(f"{name:<10}  {estimate[name]:.5g} {unit}, from {low:.5g} to {high:.5g}")

force_constant = 1.5 * estimate["back_emf"]  # of a three-phase motor
print(f"{len(record.current)} samples give a force constant of {force_constant:.2f} N/A.")
