"""What a controller knows of the state of a machine, and what that misses of the tool.

The state is measured as it is, or it is the estimate z = x - e of a filter on encoders, which moves
as

    z(k+1) = A z(k) + B u(k) + L i(k+1),   i the innovation.
All i within their largest size are then the disturbances of z, E = L |i|, and what the estimate
misses of the tool, |C e|, is added to a tolerance of z. That innovations depend on each other and
on e is not used: a tolerance made of it is kept, and it is not the least.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.linear.plant import ROUNDING, LinearPlant, spectral_radius
from jcontour.sets.disturbed_model import DisturbedModel, Numbers
from jcontour.sets.minimal_sets import minimal_supports


class Knowledge(NamedTuple):
    """Disturbances of what the controller knows of the state, and what that misses of the tool.

    Attributes:
        E: sizes of the disturbances (n, q).
        tool: largest error of the known position (m,) [m].
        speed: largest error of the known speed (m,) [m/s].
    """

    E: Float[np.ndarray, "n q"]
    tool: Float[np.ndarray, " m"]
    speed: Float[np.ndarray, " m"]


def state_known(plant: LinearPlant, force: Numbers) -> Knowledge:
    """The state is measured as it is; the force acts on the controls, one size or one for each."""
    E = DisturbedModel.loaded(plant, force).E
    C = np.asarray(plant.C)
    return Knowledge(E, np.zeros(plant.axes), np.abs(C @ E).sum(axis=1) / plant.dt)


def state_bounded_by_filter(
    plant: LinearPlant, gain: Numbers, force: Numbers, encoder: Numbers
) -> Knowledge:
    """The state is the estimate of a filter that starts without error; every size from above.

    The error before a correction moves as e(k+1) = A (I - L C) e + B f - A L n; the innovation is
    i = C e + n, the error that is left (I - L C) e - L n. Their largest sizes are those of
    `minimal_supports`.

    Args:
        plant: the machine.
        gain: filter gain L (n, m).
        force: largest force, one or one for each control [control unit].
        encoder: largest error of the measured positions, one or one for each [m].

    Raises:
        ValueError: the filter is not stable, its gain does not fit, or a size is negative.
    """
    A, C, L = (np.asarray(matrix, float) for matrix in (plant.A, plant.C, gain))
    if L.shape != C.T.shape or not np.isfinite(L).all():
        raise ValueError(
            f"gain: needs finite numbers of shape {C.T.shape}, received "
            f"{'NaN or inf' if L.shape == C.T.shape else L.shape}"
        )
    encoder = np.asarray(encoder, float)
    if not (np.isfinite(encoder) & (encoder >= 0)).all():
        raise ValueError(f"encoder: needs an error of at least zero [m], received {encoder}")
    radius = float(spectral_radius(A @ (np.eye(plant.states) - L @ C)))
    if not radius < 1 - ROUNDING:
        raise ValueError(f"gain: the filter is not stable, its spectral radius is {radius:.6g}")
    loaded, each = DisturbedModel.loaded(plant, force).E, np.eye(plant.axes)
    left = np.eye(plant.states) - L @ C
    entry = np.concatenate([loaded, -A @ L * encoder], axis=1)
    moving = C @ (A - np.eye(plant.states)) / plant.dt
    rows = np.concatenate([C, C @ left, moving @ left])
    innovation, tool, speed = minimal_supports(A @ left, entry, rows).bound.reshape(3, -1)
    now = encoder * np.abs(np.concatenate([each, C @ L, moving @ L])).sum(axis=1).reshape(3, -1)
    pushed = np.abs(C @ loaded).sum(axis=1) / plant.dt
    return Knowledge(L * (innovation + now[0]), tool + now[1], speed + now[2] + pushed)
