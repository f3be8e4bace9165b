"""Gantries that several test files drive."""

import json
from pathlib import Path

import pytest

from jcontour.plants.gantry_parameters import GantryParameters

DATA = Path(__file__).parents[2] / "data" / "gantry"
NAMES = {
    "drive_mass_1": "M_1", "drive_mass_2": "M_2", "beam_mass": "M_n", "head_mass": "M_e", "half_span": "L", "joint_length": "l",
    "half_width": "w_N", "tool_offset": "d", "joint_stiffness": "k_r", "lateral_stiffness": "k_s", "head_constant": "k_x",
    "drive_constant": "k_y", "head_viscous": "b_x", "drive_viscous": "b_y",
}  # fmt: skip


@pytest.fixture(scope="session")
def gantry_data():
    """name -> reference data on the gantry."""
    return lambda name: json.loads((DATA / f"{name}.json").read_text())


@pytest.fixture(scope="session")
def reference_gantry(gantry_data):
    """The machine of the reference data."""
    return GantryParameters(**{name: gantry_data("samples")["params"][letter] for name, letter in NAMES.items()})


@pytest.fixture(scope="session")
def odd_gantry():
    """Another machine: unequal drives, short and soft, its tool on the other side of the beam."""
    return GantryParameters(
        drive_mass_1=13.0, drive_mass_2=31.0, beam_mass=52.0, head_mass=17.0, half_span=0.6, joint_length=0.05, half_width=0.1,
        tool_offset=-0.13, joint_stiffness=9e5, lateral_stiffness=4e5, head_constant=35.0, drive_constant=80.0, head_viscous=90.0,
        drive_viscous=310.0,
    )  # fmt: skip
