import numpy as np
import pytest
from scipy.signal import cont2discrete

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.two_masses import two_masses

DT, FORCE = 5e-4, 0.4


def model(A, B, C):
    """The axis, sampled, its integrator apart."""
    a, b, c, *_ = cont2discrete((A, B, C, np.zeros((1, 1))), DT)
    poles = np.linalg.eigvals(a)
    poles = np.delete(poles, np.argmin(np.abs(poles - 1)))
    markov, x = [], b
    for _ in range(len(a)):
        markov.append((c @ x).item())
        x = a @ x
    below = np.real(np.convolve(np.poly(poles), [1.0, -1.0]))
    return AxisModel(np.real(np.poly(poles))[1:], np.convolve(markov, below)[: len(a)], 1, 2, DT)


@pytest.mark.parametrize(("motor", "load", "stiffness"), [(5e-3, 4.9e-3, 567.0), (60.0, 20.0, 2e6)])
def test_masses_and_spring_of_a_known_axis(motor, load, stiffness):
    """Damped as the bench is: c = 0.01 N s/m and viscous friction of 4 N s/m per 100 kg."""
    viscous, c = 0.04 * motor, 1e-4 * np.sqrt(stiffness * load)
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness / motor, -(c + viscous) / motor, stiffness / motor, c / motor],
            [0.0, 0.0, 0.0, 1.0],
            [stiffness / load, c / load, -stiffness / load, -c / load],
        ]
    )
    B = np.array([[0.0], [FORCE / motor], [0.0], [0.0]])
    found = two_masses(model(A, B, np.eye(1, 4)), FORCE)
    assert found == pytest.approx((motor, load, stiffness), rel=0.01)
    at_the_load = np.array([[0.0, 0.0, 1.0, 0.0]])
    assert two_masses(model(A, B, at_the_load), FORCE) is None
