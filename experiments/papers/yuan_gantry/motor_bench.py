"""Yuan, section 5.6: the gantry with an emulated head, two motors on one shaft that move as x_h.

MT1 drives and MT2 loads. Every term of the shaft's equation is a torque,

    M_A x_h'' = k_A i_x - b_A x_h' - k_A i_T - F_fn,   M_A = J_A / r_A,   b_A = b_r / r_A    (5.45)
so k_A is in N m/A, though the thesis calls it a force constant, and M_A is in kg m. The computer
simulates y_N and theta. At every sample it sends i_x and a load current under which the bench
behaves like the head but for its dry friction,

    k_A i_T = M_A ((k_A / M_A - k_x / M_e) i_x - (b_A / M_A - b_x / M_e) x_h' - d_x)       (5.46)
    x_h'' = k_x / M_e i_x - b_x / M_e x_h' + d_x - F_fn / M_A                              (5.47)
Both currents act `delay` samples later and are held; the beam goes on with the bench's x_h, x_h',
x_h''. d_x is taken at the measured state under the currents being sent. Held and late, its term
-d theta'' closes a loop through the beam: see `twist_damping`.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jcontour import LinearPlant, Plant
from jcontour.linear.transformations import with_input_delay, zoh
from jcontour.plants import Gantry, GantryParameters
from jcontour.plants.friction import Friction, caught, runge_kutta
from jcontour.plants.gantry.gantry import EquationOfMotion, Scalar
from jcontour.plants.gantry.linear_models import disturbances


class MotorBench(eqx.Module):
    """Two motors on one shaft, with all values taken at the shaft; our numbers, none is printed."""

    dry: bool = eqx.field(static=True, default=True)  # friction
    inertia: float = 1e-3  # J_A [kg m^2] of both motors and the coupling
    radius: float = 0.02  # r_A [m] of travel for an angle
    torque_constant: float = 0.5  # k_A [N m/A] of either motor

    @property
    def friction(self) -> Friction:
        """Friction of the shaft: torques [N m] over its speed [rad/s]."""
        return Friction(0.02 * self.dry, 0.01 * self.dry, 1.0, 1e-3)

    @property
    def reduced_inertia(self) -> float:
        """M_A [kg m]."""
        return self.inertia / self.radius

    @property
    def reduced_viscous(self) -> Float[Array, ""]:
        """b_A [N s]."""
        return self.friction.viscous[0] / self.radius


class Emulated(NamedTuple):
    """State of the gantry, of the bench, and of the line to the bench."""

    gantry: Float[Array, "6"]
    mode: Int[Array, "1"]  # whether the bench sticks (0) or slips (-1, 1)
    sent: Float[Array, "delay 2"]  # i_x and i_T on their way to the bench [A], the last first


class HardwareInLoop(Plant):
    """A `Gantry` whose head is a bench, measured like the gantry."""

    gantry: Gantry  # its sample period is that of the communication
    bench: MotorBench
    # samples after which both currents of the bench act; one in the thesis
    delay: int = eqx.field(static=True, default=1)

    @property
    def dt(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Sample period [s]."""
        return self.gantry.dt

    def initial_state(self, position, increment) -> Emulated:
        """State of the gantry, and a line that carries the load of a head without current."""
        state = self.gantry.initial_state(position, increment)
        before = self._sent(state, jnp.zeros(3))
        mode = jnp.sign(state[3:4]).astype(jnp.int32)
        return Emulated(state, mode, jnp.tile(before, (self.delay, 1)))

    def load_current(self, state: Float[Array, "6"], control: Float[Array, "3"]) -> Scalar:
        """Load current i_T [A] for a state under currents (i_x, i_1, i_2), eq. 5.46."""
        p, bench = self.gantry.parameters, self.bench
        M_A, b_A, k_A = bench.reduced_inertia, bench.reduced_viscous, bench.torque_constant
        d_x = disturbances(p, 0.0, state, control)[0]  # the same for every point of linearisation
        too_strong = k_A / M_A - p.head_constant / p.head_mass
        too_viscous = b_A / M_A - p.head_viscous / p.head_mass
        return M_A / k_A * (too_strong * control[0] - too_viscous * state[3] - d_x)

    def step(self, state: Emulated, control) -> Emulated:
        """State after the substeps of one sample, with the mode of the bench frozen in each."""
        bench, motion = self.bench, EquationOfMotion.of(self.gantry.parameters)
        friction = bench.friction
        line = jnp.concatenate([self._sent(state.gantry, control)[None], state.sent])
        driven, loaded = line[self.delay]
        torque = bench.torque_constant * (driven - loaded)[None]

        def substep(_, carry):
            x, mode = carry

            def rates(x):
                resisting = friction.slipping(mode, x[3:4] / bench.radius)
                along = jnp.where(mode != 0, (torque - resisting) / bench.reduced_inertia, 0)[0]
                beam = motion.beam_acceleration(x[:3], x[3:], control, along)
                return jnp.stack([*x[3:], along, *beam])

            x = runge_kutta(rates, x, self.dt / self.gantry.substeps)
            # the bench turns about without a stop where the torque is enough
            mode = friction.released(caught(mode, x[3:4]), torque)
            return x.at[3:4].set(jnp.where(mode == 0, 0, x[3:4])), mode

        start = state.gantry, friction.released(state.mode, torque)
        x, mode = jax.lax.fori_loop(0, self.gantry.substeps, substep, start)
        return Emulated(x, mode, line[: self.delay])

    def output(self, state: Emulated) -> Float[Array, "2"]:
        """The tool [m]."""
        return self.gantry.output(state.gantry)

    def measure(self, state: Emulated) -> Float[Array, "6"]:
        """Whole state of the gantry."""
        return self.gantry.measure(state.gantry)

    def _sent(self, state, control) -> Float[Array, "2"]:
        return jnp.stack([control[0], self.load_current(state, control)])


def delayed_head_model(parameters: GantryParameters, bench: MotorBench, dt: float) -> LinearPlant:
    """Model (5.50) with the state (x_h, x_h', i_x(k-1)), by exact zero-order hold.

        x_h'(k+1) = T k_x / M_e i_x(k-1) + (1 - T b_A / M_A) x_h'(k) + F_Nx(k)            (5.48)
    The input is i_x, the output x_h. The head's viscous friction is left to F_Nx, which the thesis
    takes for a bounded disturbance. It prints forward Euler, off by (T b_A / M_A)^2 / 2 of the
    speed, with the position one sample late: by T^2 k_x / (2 M_e) for an ampere.
    """
    none, one = jnp.zeros(()), jnp.ones(())
    decay = bench.reduced_viscous / bench.reduced_inertia
    A = jnp.stack([jnp.stack([none, one]), jnp.stack([none, -decay])])
    B = jnp.stack([none, parameters.head_constant / parameters.head_mass])[:, None]
    return with_input_delay(LinearPlant(*zoh(A, B, dt), jnp.eye(1, 2), dt), 1)


def twist_damping(plant: HardwareInLoop) -> Scalar:
    """Damping of the beam's twist without a controller [N m s/rad]; below zero the twist grows.

        2 b_y L^2 - M_e d^2 w sin((delay + 1/2) w T),   w^2 = 2 k_r / J_0
    for the head at the centre of the beam. The head acts on the twist by M_e d x_h'', eq. 5.9. The
    bench answers by x_h'' = -d theta'', half a sample late because it is held. This is of first
    order in M_e d^2 / J_0.
    """
    p = plant.gantry.parameters
    frequency = jnp.sqrt(2 * p.joint_stiffness / p.inertia(0.0))
    late = jnp.sin((plant.delay + 0.5) * frequency * plant.dt)
    return 2 * p.drive_viscous * p.half_span**2 - p.head_mass * p.tool_offset**2 * frequency * late
