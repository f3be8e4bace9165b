"""The gantry in the classic MuJoCo engine, on the host.

It is slow and has no derivatives. It is written by others, so that it can confirm a result.
"""

from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version

import equinox as eqx
import jax
import numpy as np

from jcontour.plants.gantry.engines.mjcf import EngineGantry, EngineState, mjcf
from jcontour.plants.gantry.gantry import substeps_of
from jcontour.plants.gantry.parameters import GantryParameters

# a pair: mujoco-mjx itself sets no bound on mujoco
WANTED = {"mujoco": "4.0.0", "mujoco-mjx": "3.17.0"}


def check_versions() -> None:
    """Raise ImportError unless the pinned pair of packages is installed."""
    for name, wanted in WANTED.items():
        try:
            found = version(name)
        except PackageNotFoundError:
            found = "none"
        if found != wanted:
            needed = f"the gantry in MuJoCo needs version {wanted}"
            raise ImportError(f"{name}: {needed}, found {found}; pip install {name}=={wanted}")


check_versions()
import mujoco  # noqa: E402

# pyright: reportAttributeAccessIssue=false
# (the engine's names are compiled: no type checker sees them)


class GantryMuJoCo(EngineGantry):
    """The gantry under `mj_step`, called back from the loop. Nothing differentiates it.

    Raises:
        ValueError: as `Gantry`, or a parameter is not a single number.
    """

    model: str = eqx.field(static=True)

    def __init__(
        self, parameters: GantryParameters, dt: float, substeps: int | float | None = None
    ):
        self.parameters, self.dt, self.substeps = parameters, float(dt), substeps_of(dt, substeps)
        self.model = mjcf(parameters, self.dt / self.substeps)

    def step(self, state: EngineState, control) -> EngineState:
        """State after one `mj_step` for each substep."""
        shapes = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), state)
        return jax.pure_callback(
            partial(_stepped, self.model, self.substeps),
            shapes,
            *state,
            control,
            vmap_method="sequential",
        )


def _stepped(xml: str, substeps: int, qpos, qvel, control) -> tuple[np.ndarray, np.ndarray]:
    data = mujoco.MjData(loaded(xml))
    data.qpos[:], data.qvel[:], data.ctrl[:3] = qpos, qvel, control
    for _ in range(substeps):
        mujoco.mj_step(loaded(xml), data)
    return data.qpos, data.qvel


@cache
def loaded(xml: str) -> mujoco.MjModel:
    """The engine's model of an XML text."""
    return mujoco.MjModel.from_xml_string(xml)
