"""The X-Y table of a Bridgeport Discovery 300 machining centre (McNab & Tsao, section 4).

Velocity commands in, positions [m] out, 2 kHz. X has three states, Y five; nothing couples the
axes.
"""

import numpy as np

from jcontour.linear.plant import LinearPlant

SAMPLE_PERIOD = 0.5e-3  # [s] the paper's 2 kHz
ENCODER_RESOLUTION = 0.8e-6  # [m] per count, the paper's encoders


def bridgeport() -> LinearPlant:
    """The paper's matrices, with two lost minus signs restored.

    The two are A[5, 5] = -0.0227 and A[6, 7] = -4.2149. As printed, Y has eigenvalues 3.59 and
    -1.97. This is the only pair of signs that gives one integrator and an otherwise stable axis;
    the ramp gains of both axes then agree to 1.2 %. Lengths are metres. Both axes have a zero
    outside the unit circle (-13.4, -17.8). The integrators sit at 0.999963 (X) and 1.000041 (Y)
    because the paper prints four decimals. An error then depends on where the part lies:
    `exact_bridgeport` is the table to work with.

    >>> table = bridgeport()
    >>> table.states, table.inputs, table.axes, table.dt
    (8, 2, 2, 0.0005)
    """
    A = np.zeros((8, 8))
    A[:3, :3] = [[-0.2916, 0.2755, -0.8029], [-0.8890, 1.6565, -0.8540], [0.0, 1.0343, 0.3324]]
    A[3:, 3:] = [
        [0.5109, 0.5102, 1.1644, 0.9037, -0.9856],
        [-0.7566, 0.7378, 0.7638, 0.9284, -1.5212],
        [0.0, 0.0344, -0.0227, 0.9665, -0.2304],
        [0.0, 0.0, 1.6801, 2.1797, -4.2149],
        [0.0, 0.0, 0.0, 0.9843, -0.6750],
    ]
    B = np.zeros((8, 2))
    B[:3, 0] = [-0.0379e-5, 0.5879e-5, 0.0402e-5]
    B[3:, 1] = [0.2101e-5, 0.2655e-5, 0.1732e-5, 0.6884e-5, 0.0332e-5]
    C = np.zeros((2, 8))
    C[0, 2] = C[1, 7] = 1.0
    return LinearPlant(A, B, C, SAMPLE_PERIOD)


def exact_bridgeport() -> LinearPlant:
    """The table with both integrators at exactly 1, so that no error depends on where a part lies.

    Of each axis one entry moves within the rounding of its fourth printed decimal, to the root of
    det(A - I), which is linear in it. No zero of A is filled. The other poles move by 2e-5.
    """
    printed = bridgeport()
    A = np.array(printed.A)
    A[0, 1] = 0.2754560202050089  # printed 0.2755
    A[5, 5] = -0.022715354721554528  # printed 0.0227, its sign restored
    return LinearPlant(A, printed.B, printed.C, printed.dt)
