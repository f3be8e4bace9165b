"""What `jcontour identify --machine linear` prints."""

from rich.console import Console

from jcontour.app.files.results.linear_result import LinearAxisResult, LinearMachineResult
from jcontour.app.reports import tables

HEADINGS = (
    "axis",
    "model",
    "gain at rest",
    "+- %",
    "delay",
    "explains %",
    "left um",
    "shown to Hz",
    "family %",
)


def show(result: LinearMachineResult, console: Console) -> None:
    """Print the axes, the family and the doubts."""
    seconds = result.samples * result.dt
    tables.say(
        console,
        f"Data: {result.data}",
        f"Used: {result.samples} samples at {1 / result.dt:.5g} Hz, {seconds:.4g} s",
        *result.words,
    )
    rows = [_cells(one) for one in result.axes]
    title = f"Identified machine; gains are per {result.control_unit}"
    console.print(tables.plain_table(title, HEADINGS, rows, text_columns=2))
    speeds = ", ".join(f"{1e3 * value:.4g}" for value in result.limits["speed"])
    accelerations = ", ".join(f"{value:.3g}" for value in result.limits["acceleration"])
    commands = ", ".join(f"{value:.4g}" for value in result.limits["control"])
    late = f" and up to {result.delay} sample more of delay" if result.delay else ""
    tables.say(
        console,
        f"Family: every gain to {100 * result.gain:.2g} %{late}",
        f"Limits in the file, the largest of the record: {speeds} mm/s; {accelerations} m/s^2; "
        f"{commands} {result.control_unit}. Change them to those of the machine.",
        *(f"NOTE: {note}" for note in result.notes),
    )


def _cells(one: LinearAxisResult) -> list[str]:
    low, high = one.gain_interval
    spread = 50 * (high - low) / abs(one.gain) if one.gain else float("nan")
    per = "mm/s" if one.integrators else "mm"
    also = f" ({', '.join(map(str, one.delays))}?)" if one.delays else ""
    return [
        one.name,
        words_of(one),
        f"{1e3 * one.gain:.5g} {per}",
        f"{spread:.2g}",
        f"{one.delay}{also}",
        f"{100 * one.explained:.3f}",
        f"{1e6 * one.innovation:.3g}",
        tables.digits(one.shown_to),
        f"{100 * one.uncertainty:.2g}",
    ]


def words_of(one: LinearAxisResult) -> str:
    """Poles of a model as an engineer says them."""
    parts = ["integrator"] if one.integrators else []
    parts += [f"{1e3 * value:.3g} ms" for value in one.time_constants]
    parts += [f"{hertz:.3g} Hz (damping {z:.2g})" for hertz, z in one.resonances]
    return ", ".join(parts) or "gain"
