import pytest

from jcontour.app.flags.tuning import Sweep, Tune
from jcontour.app.runs.spread.devices import batching_of, count_of
from jcontour.simulation.devices import Spread


def test_devices_of_the_flags():
    assert count_of(Sweep()) is None and count_of(Tune()) == 1 and count_of(Tune(devices="4")) == 4
    for devices in ("0", "-1", "two", "1.5", ""):
        with pytest.raises(ValueError, match="devices: needs 'all' or a number"):
            count_of(Tune(devices=devices))
    assert batching_of(Tune()) is None
    assert isinstance(batching_of(Tune(devices="all")), Spread)
    with pytest.raises(ValueError, match="devices: needs 1 to 2"):
        batching_of(Tune(devices="3"))
