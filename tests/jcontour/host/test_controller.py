"""A wrapper passes every kind of step through the same two doors."""

from typing import NamedTuple

import numpy as np
import pytest

from jcontour.geometry.contours import line
from jcontour.host.controller import HostController, HostWrapper, StepReport
from jcontour.motion.references import along


class Doubling(HostController):
    """Twice the measurement; its memory counts steps, held ones as a hundred."""

    preview = 3

    def __init__(self, soft=True):
        self.soft = soft

    def prepare(self, reference):
        return "plan"

    def initial_memory(self, reference):
        return 0

    def step(self, memory, plan, measurement):
        return memory + 1, 2.0 * measurement, StepReport(active=1)

    def soft_step(self, memory, plan, measurement):
        return (memory + 1, 20.0 * measurement, StepReport(active=2)) if self.soft else None

    def held(self, memory, measurement, control):
        return memory + 100

    def finished(self, memory):
        return memory == 100


class Memory(NamedTuple):
    inner: int
    last: np.ndarray


class Shifted(HostWrapper):
    """Fed one more, giving one less."""

    def initial_memory(self, reference):
        return Memory(self.controller.initial_memory(reference), np.zeros(1))

    def enter(self, memory, measurement):
        return measurement + 1

    def leave(self, memory, fed, inner, control):
        return Memory(inner, control), control - 1


@pytest.fixture
def wrapped():
    wrapper = Shifted(Doubling())
    return wrapper, wrapper.initial_memory(None)


def test_steps_go_in_and_come_out(wrapped):
    wrapper, memory = wrapped
    reference = along(line([0.0], [1e-2]), np.zeros(2), 1e-3, 0, at_rest=True)
    assert wrapper.preview == 3 and wrapper.prepare(reference) == "plan"
    after, control, report = wrapper.step(memory, None, np.ones(1))
    assert after.inner == 1 and after.last == 4.0 and control == 3.0 and report.active == 1
    after, control, report = wrapper.soft_step(memory, None, np.ones(1))
    assert after.inner == 1 and after.last == 40.0 and control == 39.0 and report.active == 2
    assert memory.inner == 0  # the memory that was given is as it was


def test_a_held_control_and_the_end_are_the_inner_ones(wrapped):
    wrapper, memory = wrapped
    held = wrapper.held(memory, np.ones(1), np.full(1, 5.0))
    assert held.inner == 100 and held.last == 5.0
    assert wrapper.finished(held) and not wrapper.finished(memory)


def test_without_a_soft_step_inside_there_is_none():
    wrapper = Shifted(Doubling(soft=False))
    assert wrapper.soft_step(Memory(0, np.zeros(1)), None, np.ones(1)) is None
