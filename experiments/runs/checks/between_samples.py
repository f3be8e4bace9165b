"""Motion between the samples of a run, which its errors do not show."""

import numpy as np

from experiments.jobs.replays import Replay, Scenarios, scored
from experiments.machines.machine import Machine
from experiments.runs.checks.machine_limits import largest_counted
from jcontour.linear.between_samples import alternating

MUCH = 0.1  # of the RMS error, from which on a swing is told


def swing_warnings(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """A line where the tool swings between samples by much of the error that the samples show.

    An acceleration a that alternates from sample to sample takes the tool a dt^2 / 8 aside.
    """
    lost = np.asarray(replay.metrics.diverged)
    control = np.where(lost[..., None, None], 0.0, replay.control)
    hidden = alternating(control) @ machine.hidden_acceleration.T
    swings = largest_counted(hidden, scored(scenarios)) * machine.model.dt**2 / 8
    errors = np.asarray(getattr(replay.metrics, f"rms_{machine.error}_error"))
    shares = np.where(lost[..., None], 0.0, swings / np.maximum(errors, 1e-12)[..., None])
    contour, plant, axis = np.unravel_index(np.argmax(shares), shares.shape)
    if shares[contour, plant, axis] <= MUCH:
        return []
    swing, error = 1e6 * swings[contour, plant, axis], 1e6 * errors[contour, plant]
    return [
        f"{machine.axes[axis]} swings by up to {swing:.3g} um between samples, beside an RMS "
        f"{machine.error} error of {error:.3g} um at samples "
        f"({scenarios.jobs[contour].name}, {scenarios.plants[plant]}): its control alternates; "
        "more weight on the control (rho) calms it"
    ]
