"""The gantry in MuJoCo MJX: the same physics in JAX, traced and differentiated like any plant."""

import contextlib
import io

import jax

from jcontour.plants.gantry.engines.mjcf import EngineGantry, EngineState, mjcf
from jcontour.plants.gantry.engines.mujoco_engine import loaded
from jcontour.plants.gantry.gantry import substeps_of
from jcontour.plants.gantry.parameters import GantryParameters

with contextlib.redirect_stdout(io.StringIO()):  # it prints about engines that are not installed
    from mujoco import mjx


class GantryMJX(EngineGantry):
    """The gantry under `mjx.step`, with the state (qpos, qvel).

    The engine's 84 arrays of data are made again in every substep. No constraint is active in the
    model, so that reverse and forward mode both work.

    Raises:
        ValueError: as `Gantry`, or a parameter is not a single number.
    """

    model: mjx.Model

    def __init__(
        self, parameters: GantryParameters, dt: float, substeps: int | float | None = None
    ):
        self.parameters, self.dt, self.substeps = parameters, float(dt), substeps_of(dt, substeps)
        self.model = mjx.put_model(loaded(mjcf(parameters, self.dt / self.substeps)))

    def step(self, state: EngineState, control) -> EngineState:
        """State after one `mjx.step` for each substep."""
        blank = mjx.make_data(self.model)
        controls = blank.ctrl.at[:3].set(control)

        def substep(_, state: EngineState) -> EngineState:
            data = blank.replace(qpos=state[0], qvel=state[1], ctrl=controls)
            # the engine's arithmetic relies on JAX's implicit promotion
            with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
                data = mjx.step(self.model, data)
            return data.qpos, data.qvel

        return jax.lax.fori_loop(0, self.substeps, substep, state)
