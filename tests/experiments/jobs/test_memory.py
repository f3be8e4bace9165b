"""Samples that a memory holds."""

import pytest

from experiments.jobs.memory import BEGUN, memory, needed, room


@pytest.mark.parametrize("plants", [1, 5])
def test_what_there_is_room_for_is_what_needs_no_more(plants):
    most = room(plants, there=24e9)
    assert needed(most, plants) <= 24e9 < needed(most + 1, plants)


def test_no_room_is_no_sample():
    assert room(5, there=BEGUN - 1) == 0


def test_a_memory_that_the_system_does_not_tell_is_no_limit(monkeypatch):
    def refuse(name):
        raise ValueError(name)

    monkeypatch.setattr("os.sysconf", refuse)
    assert memory() > 1e15 and room(5) > 1e10
