"""Tables 1 to 3 of Alter & Tsao, digit by digit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PublishedLine:
    """Line of Table 1 or 3: m, N_p, N, and errors as printed [m]."""

    line: int
    order: int
    preview: int
    constraint: int
    measured_max: str  # on the authors' machine
    printed_max: str  # simulated by the authors
    measured_rms: str
    printed_rms: str


@dataclass(frozen=True)
class PublishedCosts:
    """Row of Table 2, as printed."""

    order: int
    preview: int
    constraint: int
    printed_limit: str  # lim J_eps
    printed_optimal: str  # J_1
    printed_without: str  # |M|_1, no feedforward


TABLE_1 = (
    PublishedLine(1, 0, 0, 0, "2.6600e-2", "2.6600e-2", "1.7552e-2", "1.7552e-2"),
    PublishedLine(2, 0, 1, 0, "2.6600e-2", "2.6600e-2", "1.7552e-2", "1.7552e-2"),
    PublishedLine(3, 0, 2, 0, "8.178e-3", "8.178e-3", "5.396e-3", "5.396e-3"),
    # the scan shows 1.959e-3 for the simulated RMS (errata)
    PublishedLine(4, 0, 3, 0, "2.524e-3", "2.515e-3", "1.659e-3", "1.659e-3"),
    PublishedLine(5, 0, 4, 0, "7.77e-4", "7.73e-4", "5.08e-4", "5.10e-4"),
    PublishedLine(6, 0, 5, 0, "2.48e-4", "2.38e-4", "1.57e-4", "1.57e-4"),
    PublishedLine(7, 0, 6, 0, "8.1e-5", "7.31e-5", "4.9e-5", "4.82e-5"),
    PublishedLine(8, 0, 7, 0, "3.2e-5", "2.25e-5", "1.6e-5", "1.48e-5"),
    PublishedLine(9, 0, 8, 0, "2.5e-5", "6.91e-6", "8.1e-6", "4.56e-6"),
    PublishedLine(10, 0, 9, 0, "1.9e-5", "2.12e-6", "6.9e-6", "1.40e-6"),
    PublishedLine(11, 0, 10, 0, "1.9e-5", "6.53e-7", "6.7e-6", "4.31e-7"),
    PublishedLine(12, 0, 0, 1, "3.33e-4", "3.35e-4", "1.61e-4", "1.65e-4"),
    PublishedLine(13, 0, 0, 2, "2.6e-5", "4.47e-6", "7.9e-6", "3.00e-6"),
    PublishedLine(14, 0, 0, 3, "3.8e-5", "3.42e-6", "8.7e-6", "3.72e-7"),
    PublishedLine(15, 0, 1, 1, "1.43e-4", "1.45e-4", "6.7e-5", "7.15e-5"),
    PublishedLine(16, 0, 1, 2, "2.1e-5", "1.11e-6", "7.1e-6", "7.49e-7"),
    PublishedLine(17, 0, 1, 3, "2.2e-5", "8.56e-7", "7.1e-6", "8.13e-8"),
    PublishedLine(18, 1, 2, 0, "3.199e-3", "3.1900e-3", "2.106e-3", "2.105e-3"),
    PublishedLine(19, 1, 3, 0, "9.84e-4", "9.81e-4", "6.46e-4", "6.47e-4"),
    PublishedLine(20, 1, 4, 0, "3.11e-4", "3.02e-4", "2.00e-4", "1.99e-4"),
    PublishedLine(21, 1, 2, 2, "2.0e-5", "3.42e-7", "6.8e-6", "2.30e-7"),
    PublishedLine(22, 1, 3, 2, "1.6e-5", "5.17e-7", "6.6e-6", "3.48e-7"),
    PublishedLine(23, 1, 4, 2, "1.8e-5", "4.80e-7", "6.7e-6", "3.12e-7"),
    PublishedLine(24, 2, 3, 0, "3.92e-4", "3.83e-4", "2.54e-4", "2.53e-4"),
    PublishedLine(25, 2, 2, 2, "2.0e-5", "4.97e-7", "7.4e-6", "3.34e-7"),
    PublishedLine(26, 2, 3, 2, "1.5e-5", "9.34e-7", "6.8e-6", "6.28e-7"),
    PublishedLine(27, 2, 4, 2, "1.7e-5", "9.56e-7", "6.7e-6", "6.42e-7"),
    PublishedLine(28, 0, 2, 2, "3.0e-5", "3.49e-7", "7.8e-6", "2.31e-7"),
)
TABLE_2 = (
    PublishedCosts(0, 9, 0, "1.60e-4", "1.22e-4", "2.94"),
    PublishedCosts(0, 1, 2, "1.171", "0.895", "5.657"),
    PublishedCosts(2, 3, 2, "0.0169", "0.0129", "2.205"),
)
TABLE_3 = (
    PublishedLine(30, 0, 9, 0, "1.8e-5", "8.14e-8", "5.8e-6", "3.98e-8"),
    PublishedLine(31, 0, 1, 2, "1.8e-5", "1.11e-6", "5.6e-6", "7.49e-7"),
    PublishedLine(32, 2, 3, 2, "1.5e-5", "9.34e-7", "6.0e-6", "6.28e-7"),
)
# lines 29 and 33 are the feedback alone: 5.24e-5, 2.12e-5 and 2.76e-5, 1.58e-5
UNVERIFIABLE = "feedback alone: controllers A and B are not printed"
BANDWIDTHS_HZ = {1: "364", 2: "261"}
