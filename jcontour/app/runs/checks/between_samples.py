"""Motion between the samples of a run, which its errors do not show."""

import numpy as np

from jcontour.app.jobs.replays import Replay, Scenarios, scored
from jcontour.app.machines.machine import Machine
from jcontour.app.runs.checks.machine_limits import between_counted
from jcontour.linear.between_samples import alternating

MUCH = 0.2  # of the RMS error, from which on a swing is told
PARABOLA = np.sqrt(8 / 15)  # RMS of an arc of it over its height
LEAST = 1e-9  # error [m], below which nothing is measured


def swing_warnings(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """A line where the tool swings between samples by much of the error that the samples show.

    Swings within a count of the encoders are not told.

    An acceleration a that alternates from sample to sample takes the tool a dt^2 / 8 aside, on a
    parabola.
    """
    lost = np.asarray(replay.metrics.diverged)
    control = np.where(lost[..., None, None], 0.0, replay.control)
    aside = alternating(control) @ machine.hidden_acceleration.T * machine.model.dt**2 / 8
    counted = between_counted(scored(scenarios), aside.shape[2])[:, None, :, None]
    squares = np.sum(aside**2, axis=2, where=counted) / np.maximum(counted.sum(axis=2), 1)
    rms = PARABOLA * np.sqrt(squares)
    errors = np.asarray(getattr(replay.metrics, f"rms_{machine.error}_error"))
    most = np.where(counted, aside, 0.0).max(axis=2)
    told = ~lost[..., None] & (most > (0.0 if machine.resolution is None else machine.resolution))
    shares = np.where(told, rms / np.maximum(errors, LEAST)[..., None], 0.0)
    place = np.unravel_index(np.argmax(shares), shares.shape)
    if not shares[place] > MUCH:
        return []
    contour, plant, axis = (int(index) for index in place)
    return [
        f"{machine.axes[axis]} swings by {1e6 * rms[place]:.3g} um RMS between samples, and by up "
        f"to {1e6 * most[place]:.3g} um, beside an RMS {machine.error} error of "
        f"{1e6 * errors[contour, plant]:.3g} um at samples ({scenarios.jobs[contour].name}, "
        f"{scenarios.plants[plant]}): its control alternates; a larger rho calms given weights, "
        "--max-rms-increment tuned ones"
    ]
