import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.plants import servo_axes
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate


def test_positions_and_velocities_are_found_in_one_row_of_all_leaves():
    measurement = {"b": np.array([[4.0, 5.0]]), "a": np.array([1.0, 2.0, 3.0])}
    position, velocity = Sensors((3, 0), (1, 4), scale=np.array([1e-3, 2.0])).read(measurement)
    np.testing.assert_allclose(position, [4e-3, 2.0])
    np.testing.assert_allclose(velocity, [2e-3, 10.0])
    np.testing.assert_allclose(Sensors((2,)).positions(measurement), [3.0])


def test_motors_come_as_the_flexible_axis_measures_them():
    position, velocity = motors(2).read((np.array([1.0, 2.0]), np.array([3.0, 4.0])))
    np.testing.assert_array_equal([position, velocity], [[1.0, 2.0], [3.0, 4.0]])


@pytest.mark.parametrize("indices", [((0, 1), (2,)), ((0,), (-1,)), ((), ())])
def test_bad_indices_are_named(indices):
    with pytest.raises(ValueError, match="^sensors: "):
        Sensors(*indices)


@pytest.mark.parametrize("sensors", [Sensors((0, 4)), Sensors((0, 1), (2, 4))])
def test_a_place_beyond_the_measurement_is_told(sensors):
    measurement = np.zeros(2), np.zeros(2)
    with pytest.raises(ValueError, match="no place 4 in a measurement of 4 numbers, counted from"):
        sensors.read(measurement)


def test_a_cascade_on_sensors_that_a_machine_has_not_is_told():
    """JAX itself would read the last number in the place of one that is missing."""
    drives = servo_axes(gain=[50.0, 30.0], pole=[10.0, 5.0], dt=5e-3)
    loops = Cascade(CascadeGains(8.0, 0.6, 0.1), Sensors((0, 2), (1, 77)), drives.dt)
    lap = along(circle(1e-2), 1e-4 * np.arange(9), drives.dt, preview=1, at_rest=False)
    with pytest.raises(ValueError, match="^sensors: there is no place 77"):
        simulate(drives, loops, lap)
