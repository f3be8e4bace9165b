"""Import of the plants and controllers: the front doors answer without the heavy packages."""

import subprocess
import sys

HEAVY = {"mujoco", "scipy.optimize", "matplotlib", "numba", "qpsolvers"}
CODE = "import sys, jcontour.plants, jcontour.controllers; print(*sys.modules)"


def test_the_front_doors_import_nothing_heavy():
    command = [sys.executable, "-c", CODE]
    imported = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "jcontour.plants.gantry.motor_bench.hardware_in_loop" in imported
    assert not HEAVY & set(imported)
