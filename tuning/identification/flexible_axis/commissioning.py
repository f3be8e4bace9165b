"""The tests of a commissioning on a simulated axis, whose parameters are known.

The plant is the d-q motor with its current loop in front of the flexible axis with stick and slip.
A cascade moves it on the readings of its own encoders, so that their counts and noise are in the
loop as they are in the record. The tests are those of Yuan, section 3.3:

    electrical    steps of current to and fro, recorded at the rate of the drive
    sweep         constant speeds both ways, over several pole pitches
    moves         from rest to rest; the end effector rings on
and, beyond the thesis, the one that tells the mass of the end effector:

    shake         a steady speed under a current that passes through the end effector's own
    frequency
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.signal import chirp

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import line
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import in_time
from jcontour.plants.flexible_axis.axis import AxisParameters, FlexibleAxis
from jcontour.plants.flexible_axis.linear_motor import DrivenAxis, LinearMotor
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate
from tuning.identification.flexible_axis.instruments import InstrumentedAxis, Instruments, Seen
from tuning.identification.flexible_axis.records import Record

DRIVE, RECORDER = 1e-4, 1e-3  # [s] periods of current loop and voltage; of position loop and motion
STEP, STEP_TIME, STEPS = (
    2.5,
    0.125,
    12,
)  # [A], [s]: speeds up to 0.2 m/s within 25 mm on the thesis's axis
TRAVEL, ACCELERATION = 0.3, 2.0  # [m] over three pole pitches, [m/s^2]
SPEEDS = (0.05, 0.1, 0.2, 0.35)  # [m/s] of the sweep
SHAKEN = 1.0  # [A]: the end effector swings by some millimetres
SHAKEN_BAND = (0.7, 1.3)  # of the end effector's own frequency
GAINS = {
    "position": 30.0,
    "velocity": 55.67,
    "integral_time": 0.04,
    "feedforward": 1.0,
}  # of the thesis, and no lag


class Passes:
    """There, a pause, back, a pause, at one speed after another: a law of time for `in_time`."""

    def __init__(self, travel: float, speeds: Sequence[float], pause: float):
        self.travel = travel
        self.ways = [
            way for speed in speeds for way in [PointToPoint(travel, speed, ACCELERATION)] * 2
        ]
        self.start = np.cumsum([0.0] + [way.duration + pause for way in self.ways])

    @property
    def duration(self) -> float:
        """[s], in whole samples of the recorder."""
        return float(np.ceil(self.start[-1] / RECORDER) * RECORDER)

    def __call__(self, time: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Place on the way [m]; the last pause goes on."""
        number = np.clip(np.searchsorted(self.start, time, side="right") - 1, 0, len(self.ways) - 1)
        place = np.zeros_like(time)
        for k, way in enumerate(self.ways):
            gone = way(time[number == k] - self.start[k])
            place[number == k] = gone if k % 2 == 0 else self.travel - gone
        return place


class Commissioning:
    """A simulated axis and all that is random in its tests.

    Args:
        parameters: of the axis.
        motor: its windings.
        instruments: that record.
        seed: of all noise.
    """

    def __init__(
        self,
        parameters: AxisParameters,
        motor: LinearMotor,
        instruments: Instruments | None = None,
        seed: int = 0,
    ):
        self.parameters, self.motor = parameters, motor
        self.instruments = instruments or Instruments()
        self.random = np.random.default_rng(seed)

    def thesis_tests(self) -> list[Record]:
        """Electrical test, sweep and moves."""
        return [
            self.electrical(),
            self.motion("sweep", Passes(TRAVEL, SPEEDS, 0.1)),
            self.motion("moves", Passes(0.1, [0.25] * 3, 0.6)),
        ]

    def electrical(self) -> Record:
        """Open loop: the current steps to and fro."""
        command = STEP * np.repeat(
            np.where(np.arange(STEPS) % 2, -1.0, 1.0), round(STEP_TIME / DRIVE)
        )
        plant = self._instrumented(DRIVE, len(command))
        states = _open_loop(plant, jnp.asarray(command)[:, None])
        current_d, current_q = self._noisy(states.driven.current[:-1, 0]).T
        voltage = np.asarray(
            states.driven.voltage[1:, 0, 1]
        )  # what a state holds was applied before it
        return Record(
            "electrical",
            DRIVE,
            _readings(plant, states)[:-1, 0],
            current_q,
            voltage=voltage,
            current_d=current_d,
        )

    def motion(
        self, name: str, law: Passes, extra: Float[np.ndarray, " T"] | None = None
    ) -> Record:
        """Closed loop along a law of time, with an extra current [A] on top of the control."""
        reference = in_time(line([0.0], [law.travel]), law, law.duration, RECORDER)
        plant = self._instrumented(RECORDER, reference.steps)
        pushed = Disturbed(plant, force=None if extra is None else jnp.asarray(extra)[:, None])
        states = simulate(
            pushed, Cascade(CascadeGains(**GAINS), motors(1), RECORDER), reference
        ).state[0]
        motor, tool = _readings(plant, states)[:-1].T
        return Record(name, RECORDER, motor, self._noisy(states.current[1:, 0]), tool=tool)

    def shake(self) -> Record:
        """A steady speed, and a current whose frequency passes through that of the end effector."""
        law, p = Passes(TRAVEL, [0.1] * 2, 0.1), self.parameters
        own = float(jnp.sqrt(p.stiffness / p.tool_mass)[0]) / (2 * np.pi)
        time = np.arange(0, law.duration, RECORDER)
        return self.motion(
            "shake",
            law,
            SHAKEN * chirp(time, SHAKEN_BAND[0] * own, law.duration, SHAKEN_BAND[1] * own),
        )

    def _instrumented(self, dt: float, rows: int) -> InstrumentedAxis:
        noise = self.instruments.encoder_noise * self.random.standard_normal((rows, 2))
        driven = DrivenAxis(FlexibleAxis(self.parameters, DRIVE), self.motor, DRIVE)
        return InstrumentedAxis(
            driven=driven, noise=jnp.asarray(noise), resolution=self.instruments.resolution, dt=dt
        )

    def _noisy(self, current) -> np.ndarray:
        return np.asarray(current) + self.instruments.current_noise * self.random.standard_normal(
            current.shape
        )


@eqx.filter_jit
def _open_loop(plant: InstrumentedAxis, command: Float[Array, "T 1"]) -> Seen:
    """States (T, ...), row k before command k acts; from rest at zero."""
    start = plant.initial_state(jnp.zeros(1), jnp.zeros(1))
    return jax.lax.scan(lambda state, current: (plant.step(state, current), state), start, command)[
        1
    ]


def _readings(plant: InstrumentedAxis, states: Seen) -> Float[np.ndarray, "T 2"]:
    """Readings of motor and end effector at every state [m]."""
    return np.asarray(jax.vmap(plant.readings)(states))
