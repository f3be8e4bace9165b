import numpy as np

from tuning.identification.linear.speed_limit import speed_limit

DT = 0.01
TIME = DT * np.arange(3000)
SWEEP = 0.005 * np.sin(2 * np.pi * (0.5 + 0.07 * TIME) * TIME)


def test_a_drive_that_limits_its_speed_is_told():
    place, places = 0.0, []
    for wanted in SWEEP:
        place += float(np.clip(wanted - place, -0.1 * DT, 0.1 * DT))  # [m/s]
        places.append(place)
    said = speed_limit(1e3 * SWEEP, np.array(places), DT)
    assert "no faster than 100 mm/s" in said
    assert speed_limit(SWEEP, np.append([0.0, 0.0], SWEEP[:-2]), DT) == ""
    assert speed_limit(SWEEP, np.cumsum(np.roll(SWEEP, 700)), DT) == ""
