"""Moves of a bent reference with rapid moves: read back as they are meant."""

import numpy as np

from jcontour.app.files.bent_reference import PROGRAM, save_program
from jcontour.app.jobs.sections import Section
from jcontour.app.runs.loops.bending import moves_along
from jcontour.geometry.toolpaths import read_gcode

DT = 1e-3


def square_with_a_way_between():
    """A cut along X, a rapid move up along Y and on along X, a cut back; 10 um a sample."""
    way = [(k, 0) for k in range(300)] + [(300, k) for k in range(300)]
    way += [(300 + k, 300) for k in range(100)] + [(400 - k, 300) for k in range(301)]
    asked = ((7, "Z moves"), (8, "rapid move begins"))
    run = [
        Section(0, 300, asked=((3, "start"),)),
        Section(300, 700, rapid=True, corners=(600,), asked=asked),
        Section(700, 1000, asked=((12, "cut goes on"),)),
    ]
    return 1e-5 * np.array(way, float), run


def test_what_is_not_cut_is_read_back_as_rapid_and_the_program_stops_around_it(tmp_path):
    position, run = square_with_a_way_between()
    save_program(moves_along(position, DT, run, "part.ngc"), "XY", tmp_path)
    read = read_gcode(tmp_path / PROGRAM, "XY")
    ends = np.asarray(read.contour.position(np.asarray(read.contour.start)))
    rapid = np.flatnonzero(read.rapid)
    np.testing.assert_allclose(1e3 * ends[rapid], [[3, 0], [3, 3]], atol=1e-9)
    np.testing.assert_allclose(1e3 * ends[rapid[-1] + 1], [4, 3], atol=1e-9)
    between = [stop.after for stop in read.asks if stop.after]
    assert between == [rapid[0], rapid[-1] + 1] and {stop.why for stop in read.asks[1:]} == {"M0"}
    text = (tmp_path / PROGRAM).read_text()
    assert "M0 (part.ngc, line 7: Z moves, line 8: rapid move begins)\nG0 X3.00000 Y3.00" in text
    assert text.startswith(
        "G21 G90 G64 P0.001\nG0 X0.00000 Y0.00000\nM0 (part.ngc, line 3: start)\n"
    )
    assert text.count("M0 ") == 3
    assert read.stops.startswith("2 stops: M0 2 times")  # the first one is before the first cut
