"""Samples that fit into the free memory."""

from types import SimpleNamespace

import psutil
import pytest

from jcontour.app.jobs.pace import BEGUN, check_memory, free_memory, most_samples


@pytest.fixture
def free(monkeypatch):
    """Set the memory that is free [bytes]: what others have taken is not."""

    def there(available):
        taken = SimpleNamespace(total=64e9, available=available)
        monkeypatch.setattr(psutil, "virtual_memory", lambda: taken)

    return there


@pytest.mark.parametrize("plants", [1, 5])
def test_what_does_not_fit_into_the_memory_is_refused(free, plants):
    free(24e9)
    assert free_memory() == 24e9
    most = most_samples(plants)
    check_memory("slow", most, plants)
    with pytest.raises(ValueError, match=rf"slow: {most + 1:,} samples .* 24 are free: give"):
        check_memory("slow", most + 1, plants)


def test_without_memory_there_is_no_sample(free):
    free(BEGUN - 1)
    assert most_samples(5) == 0
    with pytest.raises(ValueError, match="GB of memory"):
        check_memory("none", 0, 5)
