"""The gantry as a MuJoCo model, written from the same parameters.

A beam slides along y and turns about z. The drives are point masses at its ends, the head slides
along it. The drives' currents, their friction and the lateral springs are actuators on sites at the
joints, along the axes of the world:

    force = gain u - stiffness x - damping v
with the position x against a site at rest. So the kinematics of the engine make (5.5), (5.6) and
the spring of the potential.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plant import Plant
from jcontour.plants.gantry.parameters import GantryParameters, untwisted

POINT = 1e-12  # [kg m^2] inertia that the engine wants of a point mass
ENGINE_ORDER = np.array([1, 2, 0])  # (x_h, y_N, theta) to (y_N, theta, x_h), the joints' order
OUR_ORDER = np.array([2, 0, 1])  # and back

TABLE = -0.2  # [m] height of what the tool works on; for the eye alone, as all geometry is
LARGEST_PICTURE = (1280, 720)  # [pixels] that is rendered

EngineState = tuple[Float[Array, "3"], Float[Array, "3"]]  # (qpos, qvel) in the engine's order


class EngineGantry(Plant):
    """Common part of the gantry in both engines.

    The state is (qpos, qvel), measured in the order of `Gantry`. Substeps are RK4 steps.

    Args:
        parameters: of the machine.
        dt: sample period [s].
        substeps: per sample; as many as `SUBSTEP` of `Gantry` fits into the sample when not given.
    """

    parameters: GantryParameters
    model: Any
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    @property
    def alike_everywhere(self) -> tuple[bool, ...]:
        """Along Y; the place of the head on the beam changes the inertia of twist."""
        return False, True

    def initial_state(self, position, increment) -> EngineState:
        """State without twist, the tool through `position`, at rest or at a steady speed.

        Raises:
            ValueError: the head would be outside the beam.
        """
        state = untwisted(self.parameters, position, jnp.asarray(increment) / self.dt)
        return state[ENGINE_ORDER], state[3 + ENGINE_ORDER]

    def output(self, state: EngineState) -> Float[Array, "2"]:
        """The tool [m]."""
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
    L, d, w = p["half_span"], p["tool_offset"], max(p["half_width"], 0.01)
    rail = L + p["joint_length"]
    inertia = float(parameters.beam_inertia)
    drive_bias = f'gainprm="{p["drive_constant"]!r}" biasprm="0 0 {-p["drive_viscous"]!r}"'
    spring_bias = f'gainprm="0" biasprm="0 {-p["lateral_stiffness"]!r} 0"'
    return f"""<mujoco model="gantry">
  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>
  <option timestep="{timestep!r}" integrator="RK4" gravity="0 0 0"><flag contact="disable"
      constraint="disable"/></option>
  <default>
    <geom contype="0" conaffinity="0" mass="0"/>
    <general gaintype="fixed" biastype="affine" dyntype="none" ctrllimited="false"/>
  </default>
  <visual>
    <global fovy="20" offwidth="{LARGEST_PICTURE[0]}" offheight="{LARGEST_PICTURE[1]}"/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0.4 0.4 0.4" specular="0 0 0"/>
  </visual>
  <asset><texture type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="8"
      height="8"/></asset>
  <worldbody>
    <light pos="0 -2 4" dir="0.3 0.4 -1" directional="true" diffuse="0.4 0.4 0.4" specular="0 0 0"/>
    <geom type="box" pos="0 0 {TABLE - 0.01!r}" size="{rail + 0.3!r} {2 * L!r} 0.01"
        rgba="0.93 0.94 0.95 1"/>
    <geom type="box" pos="{-rail!r} 0 {TABLE + 0.065!r}" size="0.04 {2 * L!r} 0.065"
        rgba="0.74 0.76 0.79 1"/>
    <geom type="box" pos="{rail!r} 0 {TABLE + 0.065!r}" size="0.04 {2 * L!r} 0.065"
        rgba="0.74 0.76 0.79 1"/>
    <site name="rest_1" pos="{-L!r} 0 0"/>
    <site name="rest_2" pos="{L!r} 0 0"/>
    <body name="beam">
      <inertial pos="0 0 0" mass="{p["beam_mass"]!r}"
          diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
      <joint name="y_N" type="slide" axis="0 1 0"/>
      <joint name="theta" type="hinge" axis="0 0 1" stiffness="{2 * p["joint_stiffness"]!r}"/>
      <geom type="box" size="{L!r} {w / 2!r} 0.04" rgba="0.35 0.5 0.75 1"/>
      {_drive(1, -L, p)}
      {_drive(2, L, p)}
      <body name="head" pos="0 {-d!r} 0">
        <inertial pos="0 0 0" mass="{p["head_mass"]!r}" diaginertia="{POINT} {POINT} {POINT}"/>
        <joint name="x_h" type="slide" axis="1 0 0"/>
        <geom type="box" pos="0 {d / 2!r} 0.05" size="0.05 {abs(d) / 2 + 0.05!r} 0.012"
            rgba="0.85 0.45 0.2 1"/>
        <geom type="cylinder" pos="0 0 {TABLE / 2 + 0.02!r}" size="0.025 {-TABLE / 2 - 0.02!r}"
            rgba="0.85 0.45 0.2 1"/>
        <geom type="cylinder" pos="0 0 {TABLE + 0.02!r}" size="0.006 0.02" rgba="0.15 0.15 0.18 1"/>
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
    length = p["joint_length"] * (1 if x > 0 else -1)
    return f"""<body name="drive_{number}" pos="{x!r} 0 0">
        <inertial pos="0 0 0" mass="{p[f"drive_mass_{number}"]!r}"
            diaginertia="{POINT} {POINT} {POINT}"/>
        <geom type="box" pos="{length!r} 0 0" size="0.08 0.1 0.05" rgba="0.3 0.3 0.35 1"/>
        <site name="joint_{number}"/>
      </body>"""


def _number(name: str, value) -> float:
    if getattr(value, "ndim", 0) != 0:
        raise ValueError(f"{name}: a MuJoCo model needs one number, received shape {value.shape}")
    return float(value)
