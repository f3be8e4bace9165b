"""Fields of the file of a linear machine: JSON, or an npz with the same names.

In an npz what is nested has a point in its name, as `limits.speed`. `example.json` beside the
machines is such a file; `jcontour machine --example FILE` writes it.
"""

from typing import Annotated

from pydantic import Field

from jcontour.app.files.schema import (
    Matrix,
    Note,
    NotNegative,
    Number,
    OneOrEach,
    Positive,
    Row,
    Schema,
    Text,
    Unit,
    Whole,
)

MOST_DELAY = 50  # samples


Rows = Annotated[list[list[Number]], Field(title="lists, one per axis")]


class LimitFields(Schema):
    """Greatest magnitudes."""

    speed: OneOrEach[Positive] | None = None
    """[length/s]"""
    acceleration: OneOrEach[Positive] | None = None
    """[length/s^2]; a motion asks for half of it"""
    jerk: OneOrEach[Positive] | None = None
    """[length/s^3] of a motion; when not given, the acceleration builds up in 20 ms"""
    control: OneOrEach[Positive] | None = None
    """[control unit]"""
    increment: OneOrEach[Positive] | None = None
    """of the control [control unit per sample]"""


class ResponseFields(Schema):
    """How far off the frequency response may be; tuned loops stay stable for twice as much."""

    hertz: Row
    """rising frequencies [Hz], up to half of the sample rate"""
    relative: Matrix
    """abs(G_true / G - 1) at these frequencies, one row per axis"""


class MeasuredFields(Schema):
    """G_measured / G - 1, where a record shows the response by itself.

    A tuned loop keeps the limit on its peak sensitivity on it as well.
    """

    hertz: Rows
    """frequencies [Hz], one list per axis, as in the other fields"""
    real: Rows
    """real parts of G_measured / G - 1"""
    imaginary: Rows
    """imaginary parts"""
    half_width: Rows
    """of their 95 % intervals"""


class UncertaintyFields(Schema):
    """What is not known about a machine."""

    gain: Annotated[NotNegative, Field(lt=1)] = 0.0
    """fraction to which each input gain is known; of a drive that takes a position, for moves from
    where the part begins"""
    delay: Annotated[Whole, Field(le=MOST_DELAY)] = 0
    """most samples of delay that the model does not have"""
    response: ResponseFields | None = None
    """how far off the frequency response may be"""
    measured: MeasuredFields | None = None
    """the response that was measured, beside the model's"""


class LinearMachineFile(Schema):
    """A machine x(k+1) = A x + B u, y = C x of two or three axes.

    Every axis has one input and one output of its own: the tool starts in steady motion.
    """

    name: Text | None = None
    """for tables; the file's name when not given"""
    length_unit: Unit = "m"
    """of y, of the limits, of the encoders' counts and of their noise"""
    control_unit: Text = "control unit"
    """for tables and figures"""
    axes: list[Text] | None = None
    """names, one per output; X, Y, Z when not given"""
    A: Matrix
    """of the state"""
    B: Matrix
    """of the control"""
    C: Matrix
    """of the position of the tool point [length]"""
    dt: Positive
    """sample period [s]"""
    limits: LimitFields = LimitFields()
    """greatest magnitudes"""
    known_delay: Annotated[Whole, Field(le=MOST_DELAY)] = 0
    """samples between a control and its effect that A and B do not contain; goes into the model"""
    uncertainty: UncertaintyFields | None = None
    """what is not known; when not given, gains known to 10 % (of a drive that takes a position:
    exactly) and a sample of delay"""
    encoder_resolution: OneOrEach[Positive] | None = None
    """[length] per count; 0.8 um when not given"""
    encoder_noise: OneOrEach[NotNegative] = 0.0
    """[length] standard deviation of the noise of the encoders beside their rounding"""
    control_noise: Positive | None = None
    """[control unit] standard deviation that the Kalman filter assumes on each control; when not
    given, 5 % of the control limit, or 0.1: about what an input gain 10 % off does"""
    friction: OneOrEach[NotNegative] | None = 0.0
    """[control unit] that dry friction takes, null where it is not known; it is in
    the runs, and what is proven takes it as a force"""
    backlash: OneOrEach[NotNegative] = 0.0
    """[length] gap between the motor, where the encoders are, and the tool; it is in the runs, and
    --backlash compensates it"""
    note: Note | None = None
    """repeated by `simulate`, `tune` and `machine`"""
