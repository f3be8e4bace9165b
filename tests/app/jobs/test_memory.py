"""Samples that fit into the free memory."""

from types import SimpleNamespace

import psutil
import pytest

from jcontour.app.jobs.memory import BEGUN, free_memory, needed, room


@pytest.mark.parametrize("plants", [1, 5])
def test_what_there_is_room_for_is_what_needs_no_more(plants):
    most = room(plants, there=24e9)
    assert needed(most, plants) <= 24e9 < needed(most + 1, plants)


def test_no_room_is_no_sample():
    assert room(5, there=BEGUN - 1) == 0


def test_memory_that_others_have_taken_is_not_free(monkeypatch):
    taken = SimpleNamespace(total=24e9, available=3e9)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: taken)
    assert free_memory() == 3e9
    assert needed(room(5), 5) <= 3e9
