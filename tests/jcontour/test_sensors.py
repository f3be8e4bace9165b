import numpy as np
import pytest

from jcontour.sensors import Sensors, motors


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
