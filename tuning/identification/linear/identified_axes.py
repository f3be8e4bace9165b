"""What a record of a machine says: its axes, their models, and how sure they are."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from tuning.identification.linear import validation
from tuning.identification.linear.machine_record import MachineRecord
from tuning.identification.linear.output_error import AxisFit
from tuning.identification.linear.validation import Estimate

if TYPE_CHECKING:  # a record that is refused loads no JAX
    from jcontour.linear.plant import LinearPlant

FAIR = 0.99  # part of the variance explained on held-out data below which a model is doubted
RESONANT = 100.0  # [Hz] up to which a drive may ring; of a slow clock what its rate allows
OF_RATE = 0.1  # of the sampling rate


@dataclass(frozen=True)
class IdentifiedAxis:
    """One identified axis."""

    name: str  # of the axis
    fit: AxisFit  # model on the whole record
    estimate: Estimate  # of its coefficients
    response: validation.Response  # with intervals
    # what periods of the record show of the response; none of a record without
    lines: validation.Response
    # position that the model gives for the last part of the record [m]
    held_out: Float[np.ndarray, " R"]
    explained: float  # part of the variance of the speed there that it explains
    # command that Coulomb friction takes, and its standard deviation; None if not seen
    friction: tuple[float, float] | None
    ripple: float  # part of it by which a slow force changes along the axis; 0 without friction
    stribeck: tuple[float, float] | None  # what is more at rest, speed [m/s] where half is left
    # constant command that acts beside the given one while the axis moves; told where friction
    # holds the axis at times, else 0
    offset: float
    saturated: float  # part of the samples at an extreme command
    # part of the errors that another axis explains, by its name; 0 if by chance
    coupling: dict[str, float]
    gain: float  # relative uncertainty
    dispersion: float  # by how much more than noise the errors pull at the model; 1 if by chance
    late: int  # further samples of delay that the data allow, 0 or 1
    resolution: float  # of the encoder [m]
    encoder_noise: float  # standard deviation of the encoder beside its rounding [m]; 0 if not sure

    @property
    def hides_friction(self) -> bool:
        """Whether something acts that may be dry friction, and no number for it is sure."""
        return self.friction is None and self.dispersion > 1 and self.explained < FAIR

    @property
    def unseen(self) -> bool:
        """Whether the record hides how the axis answers where it may ring: it is said, with advice.

        The response is known to 10 % up to a low frequency only.
        """
        reach = min(RESONANT, OF_RATE / self.fit.model.dt)
        return not self.response.band[1] >= reach


@dataclass(frozen=True)
class IdentifiedMachine:
    """What a record says about a machine."""

    record: MachineRecord  # it was found from
    axes: list[IdentifiedAxis]  # one model each
    notes: list[str]  # what the data do not show, or contradict

    @property
    def known_delay(self) -> int:
        """Samples of delay that all axes share."""
        return min(one.fit.model.delay for one in self.axes)

    def plant(self) -> "LinearPlant":
        """Model of all axes side by side, without the delay that they share."""
        from jcontour.linear.plant import LinearPlant

        shared = self.known_delay
        parts = [one.fit.model.realisation(one.fit.model.delay - shared) for one in self.axes]
        A, B, C = (block_diag(*matrices) for matrices in zip(*parts, strict=True))
        return LinearPlant(A, B, C, self.record.dt)

    def twice(self, name: str) -> "IdentifiedMachine":
        """A machine of two such axes, from a record of one."""
        record, one = self.record, self.axes[0]
        both = replace(
            record,
            axes=(one.name, name),
            command=np.repeat(record.command, 2, axis=1),
            position=np.repeat(record.position, 2, axis=1),
        )
        return replace(self, record=both, axes=[one, replace(one, name=name)])

    @property
    def gain(self) -> float:
        """Relative uncertainty of every input gain."""
        return max(one.gain for one in self.axes)

    @property
    def late(self) -> int:
        """Further samples of delay that the data allow."""
        return max(one.late for one in self.axes)

    @property
    def shown_to(self) -> float:
        """Frequency up to which all responses are known to 10 % [Hz]; nan if nowhere."""
        return float(np.min([one.response.band[1] for one in self.axes]))
