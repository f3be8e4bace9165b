"""Chirps on a simulated gantry: what its commissioning would record, encoders and all."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.signal import chirp
from scipy.signal.windows import tukey

from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.parameters import GantryParameters
from tuning.identification.gantry.gantry import GantryRecord

PEAK = 4.0  # [A] thesis, section 5.2.2
HEADS = (0.0, -0.66)  # [m] likewise
SWEEP, DURATION, REST, SAMPLE = (1.0, 120.0), 10.0, 2.0, 1e-3  # [Hz], [s]
FADE = 0.1  # of the sweep, at both ends together
HOLD = 60.0  # [rad/s] of the loop that holds the head, damped by 0.7
RESOLUTION, NOISE = (
    1e-6,
    3e-7,
)  # [m] of an encoder's count, and of what is added before it is rounded


def commissioned(
    parameters: GantryParameters, seed: int, heads: Sequence[float] = HEADS, noise: float = NOISE
) -> list[GantryRecord]:
    """A record for each head position.

    Drive 1 gets a chirp, the held head the same backwards, drive 2 no current.

    `noise` [m] is the standard deviation of what is added to the encoders before they count.
    """
    random = np.random.default_rng(seed)
    rows = round((DURATION + REST) / SAMPLE)
    return [
        _recorded(
            parameters, jnp.asarray(head), jnp.asarray(noise * random.standard_normal((rows, 3)))
        )
        for head in heads
    ]


def excitation() -> Float[np.ndarray, "T 2"]:
    """Currents added to i_x, and i_1 [A]: they swell up, sweep and fade, then rest."""
    time = np.arange(round(DURATION / SAMPLE)) * SAMPLE
    swept = PEAK * tukey(time.size, FADE) * chirp(time, SWEEP[0], DURATION, SWEEP[1], phi=-90)
    return np.concatenate(
        [np.stack([swept[::-1], swept], axis=1), np.zeros((round(REST / SAMPLE), 2))]
    )


def _recorded(parameters: GantryParameters, head, noise) -> GantryRecord:
    return GantryRecord(SAMPLE, *(np.asarray(signal) for signal in _run(parameters, head, noise)))


@jax.jit
def _run(parameters: GantryParameters, head, noise):
    plant, mass = Gantry(parameters, SAMPLE, substeps=16), parameters.head_mass

    def step(carry, row):
        state, before = carry
        (added, current), disturbed = row
        reading = RESOLUTION * jnp.round((parameters.motors(state)[:3] + disturbed) / RESOLUTION)
        pull = HOLD**2 * (head - reading[0]) - 1.4 * HOLD * (reading[0] - before) / SAMPLE
        control = jnp.stack(
            [mass * pull / parameters.head_constant + added, current, jnp.zeros(())]
        )
        return (plant.step(state, control), reading[0]), (control, reading)

    start = jnp.zeros(6).at[0].set(head)
    return jax.lax.scan(step, (start, head), (jnp.asarray(excitation()), noise))[1]
