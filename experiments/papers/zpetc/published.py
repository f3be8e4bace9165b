"""Numbers in print in Smith & Lee, section by section."""

from typing import NamedTuple


class PublishedModel(NamedTuple):
    """Discrete model in print: (6), (7), (16), (17) and (19)."""

    item: str
    gain: str
    zero: str
    poles: tuple[str, str]


class PublishedTime(NamedTuple):
    """Row of Table 2: mean absolute errors [um], measured."""

    good: float
    poor: float


POLE = 567.0  # of (1), in print [rad/s]
CORRECTED_POLE = 567.5  # gives the printed digits (errata)
PLANT_3_MS = PublishedModel("(6)", "0.0449", "0.5737", ("1", "0.1822"))
LOOP_3_MS = PublishedModel("(7)", "3.673e-2", "0.5737", ("0.2196", "0.9259"))
PLANT_17_MS = PublishedModel("(16)", "0.4335", "0.1171", ("1", "7.235e-5"))
LOOP_17_MS = PublishedModel("(17)", "0.2995", "0.1171", ("0.0544", "0.6461"))
FIRST_ORDER = ("0.3539", "0.6461")  # (19): b_0 and the pole
PREFILTER = ("6.3060", "3.7692", "-11.3100", "2.2348")  # (8)
WITHOUT_INTEGRATOR = 546.1  # [um]
WITH_INTEGRATOR = 111.8  # [um], in the text; Table 2 has 66.5
BEST_TIME = 0.05  # [s], section 5.1: with the least mean error of Table 2
TABLE_2 = (  # its column of integral times is lost
    PublishedTime(99.3, 74.7),
    PublishedTime(67.1, 42.9),
    PublishedTime(66.5, 41.9),
    PublishedTime(71.1, 44.2),
    PublishedTime(81.0, 57.9),
)
AMPLIFIER = {"Table 1": 38.0, "text": 750.0}  # [A/V]
GAIN = "16359"  # of (1)
