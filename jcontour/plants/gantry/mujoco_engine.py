"""The gantry in MuJoCo, on the host and as MJX in JAX, from the same parameters.

It is written by others, so that it can confirm a result. On the host it is slow and has no
derivatives; MJX is traced and differentiated like any plant.

A beam slides along y and turns about z. The drives are point masses at its ends, the head slides
along it. The drives' currents, their friction and the lateral springs are actuators on sites at the
joints, along the axes of the world:

    force = gain u - stiffness x - damping v
with the position x against a site at rest. So the kinematics of the engine make (5.5), (5.6) and
the spring of the potential.
"""

import contextlib
import io
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plants.gantry.gantry import GantryParameters, GantryPlant

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


POINT = 1e-12  # [kg m^2] inertia that the engine wants of a point mass
ENGINE_ORDER = np.array([1, 2, 0])  # (x_h, y_N, theta) to (y_N, theta, x_h), the joints' order
OUR_ORDER = np.array([2, 0, 1])  # and back

EngineState = tuple[Float[Array, "3"], Float[Array, "3"]]  # (qpos, qvel) in the engine's order


class EngineGantry(GantryPlant):
    """Common part of the gantry in both engines.

    The state is (qpos, qvel), measured in the order of `Gantry`. Substeps are RK4 steps.
    """

    def initial_state(self, position, increment) -> EngineState:
        state = self.straight(position, increment)
        return state[ENGINE_ORDER], state[3 + ENGINE_ORDER]

    def output(self, state: EngineState) -> Float[Array, "2"]:
        return self.parameters.tool(state[0][OUR_ORDER])

    def measure(self, state: EngineState) -> Float[Array, "6"]:
        """State (x_h, y_N, theta, rates), as `Gantry` measures it."""
        return jnp.concatenate([state[0][OUR_ORDER], state[1][OUR_ORDER]])


def mjcf(parameters: GantryParameters, timestep: float) -> str:
    """Model as XML, with the coordinates (y_N, theta, x_h).

    The controls are (i_x, i_1, i_2), and two without effect for the springs.

    Raises:
        ValueError: a parameter is not a single number.
    """
    p = {name: _number(name, value) for name, value in vars(parameters).items()}
    L, inertia = p["half_span"], float(parameters.beam_inertia)
    drive_bias = f'gainprm="{p["drive_constant"]!r}" biasprm="0 0 {-p["drive_viscous"]!r}"'
    spring_bias = f'gainprm="0" biasprm="0 {-p["lateral_stiffness"]!r} 0"'
    return f"""<mujoco model="gantry">
  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>
  <option timestep="{timestep!r}" integrator="RK4" gravity="0 0 0"><flag contact="disable"
      constraint="disable"/></option>
  <default>
    <general gaintype="fixed" biastype="affine" dyntype="none" ctrllimited="false"/>
  </default>
  <worldbody>
    <site name="rest_1" pos="{-L!r} 0 0"/>
    <site name="rest_2" pos="{L!r} 0 0"/>
    <body name="beam">
      <inertial pos="0 0 0" mass="{p["beam_mass"]!r}"
          diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
      <joint name="y_N" type="slide" axis="0 1 0"/>
      <joint name="theta" type="hinge" axis="0 0 1" stiffness="{2 * p["joint_stiffness"]!r}"/>
      {_drive(1, -L, p)}
      {_drive(2, L, p)}
      <body name="head" pos="0 {-p["tool_offset"]!r} 0">
        <inertial pos="0 0 0" mass="{p["head_mass"]!r}" diaginertia="{POINT} {POINT} {POINT}"/>
        <joint name="x_h" type="slide" axis="1 0 0"/>
        <site name="tool"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general name="i_x" joint="x_h" gainprm="{p["head_constant"]!r}"
        biasprm="0 0 {-p["head_viscous"]!r}"/>
    <general name="i_1" site="joint_1" refsite="rest_1" gear="0 1 0 0 0 0" {drive_bias}/>
    <general name="i_2" site="joint_2" refsite="rest_2" gear="0 1 0 0 0 0" {drive_bias}/>
    <general name="spring_1" site="joint_1" refsite="rest_1" gear="1 0 0 0 0 0" {spring_bias}/>
    <general name="spring_2" site="joint_2" refsite="rest_2" gear="1 0 0 0 0 0" {spring_bias}/>
  </actuator>
</mujoco>
"""


def _drive(number: int, x: float, p: dict[str, float]) -> str:
    return f"""<body name="drive_{number}" pos="{x!r} 0 0">
        <inertial pos="0 0 0" mass="{p[f"drive_mass_{number}"]!r}"
            diaginertia="{POINT} {POINT} {POINT}"/>
        <site name="joint_{number}"/>
      </body>"""


def _number(name: str, value) -> float:
    if getattr(value, "ndim", 0) != 0:
        raise ValueError(f"{name}: a MuJoCo model needs one number, received shape {value.shape}")
    return float(value)


class GantryMuJoCo(EngineGantry):
    """The gantry under `mj_step`, called back from the loop. Nothing differentiates it.

    Raises:
        ValueError: as `Gantry`, or a parameter is not a single number.
    """

    model: str = eqx.field(static=True)

    def __init__(
        self, parameters: GantryParameters, dt: float, substeps: int | float | None = None
    ):
        GantryPlant.__init__(self, parameters, dt, substeps)
        self.model = mjcf(parameters, self.dt / self.substeps)

    def step(self, state: EngineState, control) -> EngineState:
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


@cache
def _mjx() -> Any:
    """The engine in JAX, imported when the first machine is made: it takes seconds."""
    with contextlib.redirect_stdout(io.StringIO()):  # it prints about engines not installed
        from mujoco import mjx
    return mjx


class GantryMJX(EngineGantry):
    """The gantry under `mjx.step`, with the state (qpos, qvel).

    The engine's 84 arrays of data are made again in every substep. No constraint is active in the
    model, so that reverse and forward mode both work.

    Raises:
        ValueError: as `Gantry`, or a parameter is not a single number.
    """

    model: Any

    def __init__(
        self, parameters: GantryParameters, dt: float, substeps: int | float | None = None
    ):
        GantryPlant.__init__(self, parameters, dt, substeps)
        self.model = _mjx().put_model(loaded(mjcf(parameters, self.dt / self.substeps)))

    def step(self, state: EngineState, control) -> EngineState:
        mjx = _mjx()
        blank = mjx.make_data(self.model)
        controls = blank.ctrl.at[:3].set(control)

        def substep(_, state: EngineState) -> EngineState:
            data = blank.replace(qpos=state[0], qvel=state[1], ctrl=controls)
            # the engine's arithmetic relies on JAX's implicit promotion
            with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
                data = mjx.step(self.model, data)
            return data.qpos, data.qvel

        return jax.lax.fori_loop(0, self.substeps, substep, state)
