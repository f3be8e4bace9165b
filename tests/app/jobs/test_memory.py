"""Samples that fit into the free memory."""

from types import SimpleNamespace

import psutil
import pytest

from jcontour.app.jobs.memory import BEGUN, check_memory, free_memory, most_samples


@pytest.mark.parametrize("plants", [1, 5])
def test_what_does_not_fit_into_the_memory_is_refused(plants):
    most = most_samples(plants, there=24e9)
    check_memory("slow", most, plants, there=24e9)
    with pytest.raises(ValueError, match=rf"slow: {most + 1:,} samples .* 24 are free: give"):
        check_memory("slow", most + 1, plants, there=24e9)


def test_without_memory_there_is_no_sample():
    assert most_samples(5, there=BEGUN - 1) == 0
    with pytest.raises(ValueError, match="GB of memory"):
        check_memory("none", 0, 5, there=BEGUN - 1)


def test_memory_that_others_have_taken_is_not_free(monkeypatch):
    taken = SimpleNamespace(total=24e9, available=3e9)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: taken)
    assert free_memory() == 3e9
    check_memory("half", most_samples(5), 5)  # asks the computer
