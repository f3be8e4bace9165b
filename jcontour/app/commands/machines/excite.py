"""`jcontour identify --excite limits.json`: programs whose record shows the axes."""

import numpy as np

from jcontour.app.files import run_folder
from jcontour.app.files.checks import bytes_of, json_value, named
from jcontour.app.flags.machines import Identify
from jcontour.app.jobs.excitation import PART, gcode, letters, program, read_limits
from jcontour.app.reports import tables

MOST_BYTES = 2**20  # of the limits
CSV, GCODE = "excite.csv", "excite.ngc"


def command(flags: Identify) -> int:
    """Write both programs; exit code."""
    path = flags.excite
    assert path is not None
    content = bytes_of(path, MOST_BYTES)
    with named(path):
        given = json_value(content)
    limits = read_limits(path, given)
    folder = run_folder.create(
        flags.out or run_folder.default_folder("excite"), "identify", flags, [path]
    )
    positions = program(limits)
    time = limits.dt * np.arange(len(positions))
    head = ",".join(["time_s", *(f"{name.lower()}_mm" for name in limits.axes)])
    rows = np.column_stack([time, 1e3 * positions])
    run_folder.write(
        folder / CSV,
        lambda temporary: np.savetxt(temporary, rows, "%.9g", ",", header=head, comments=""),
    )
    text = gcode(limits)
    run_folder.write(folder / GCODE, lambda temporary: temporary.write_text(text))
    if flags.json:
        files = {"csv": str(folder / CSV), "gcode": str(folder / GCODE)}
        print(run_folder.json_text({"run": str(folder), **files}))
        return 0
    used = ", ".join(
        f"{name} +-{1e3 * float(np.abs(column).max()):.3g} mm"
        for name, column in zip(limits.axes, positions.T, strict=True)
    )
    moved = "".join(
        f"; {letter} moves {name}"
        for letter, name in zip(letters(limits), limits.axes, strict=True)
        if letter != name
    )
    names = " ".join(f"{name.lower()}_command" for name in limits.axes)
    columns = f"time {names} {names.replace('command', 'position')}"
    tables.say(
        tables.console_of(),
        f"{folder / CSV}: multisines and moves, set-points [mm] every {1e3 * limits.dt:g} ms, "
        f"{len(positions) * limits.dt:.3g} s, {used}",
        f"{folder / GCODE}: moves to and fro within {100 * PART:g} % of the travel either way"
        f"{moved}",
        "Start in the middle of the travel, with nothing in the way and a hand on the stop button.",
        f"Run the first on the machine as it is, the other where it takes G-code alone. Record: "
        f"{columns}",
        "Then: jcontour identify LOG.csv",
    )
    return 0
