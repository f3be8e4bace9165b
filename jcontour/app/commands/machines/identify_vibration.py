"""`jcontour identify RAW_X RAW_Y`: the resonances of axes, from records of an accelerometer."""

from jcontour.app.files.checks import named
from jcontour.app.files.results.machine_results import VibrationResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.vibration_file import read_vibration
from jcontour.app.flags.machines import Identify
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.identification import vibration_figure
from jcontour.app.reports.screen import Entry, next_step
from jcontour.app.runs.lifecycle import created, finished
from tuning.identification.vibration import resonances

MODE = "{:.4g} Hz ({:.4g} to {:.4g}), damping {:.3g} ({:.3g} to {:.3g}), 95 %; "
MOVED = "the tool moves X {:.0%}, Y {:.0%}, Z {:.0%}"
KLIPPER = "shaper_freq_{0}: {1:.1f}, damping_ratio_{0}: {2:.3f}"
STEP = "jcontour machine --takes position --gain 1 --time-constant-ms 1 --axes"


def command(flags: Identify) -> int:
    """Read, fit, store and print; exit code."""
    axes, figures = {}, {}
    for path in filter(None, (flags.data, flags.other)):
        with named(path):
            vibration = read_vibration(path)
            name = "XYZ"[vibration.axis]
            if name in axes:
                raise ValueError(f"shakes {name}, as the other file does; give records of two axes")
            axes[name] = resonances(vibration)
        figures[name] = vibration_figure(name, vibration, axes[name])
    folder, result = created(flags, "identify"), VibrationResult(axes)
    for name, figure in figures.items():
        save_figure(figure, folder / f"vibration-{name}.png")
    write_result(folder, result)
    return finished(folder, result, flags, lambda *_: None, answer_of(result))


def answer_of(result: VibrationResult) -> list[Entry]:
    """Entries of the screen: the resonances, and where the main ones go on."""
    main = {x: (found[0].frequency[0], found[0].damping[0]) for x, found in result.axes.items()}
    modes = [(x, one) for x, found in result.axes.items() for one in found]
    words = [(MODE + MOVED).format(*one.frequency, *one.damping, *one.shares) for _, one in modes]
    entries = [Entry(x, said) for (x, _), said in zip(modes, words, strict=True)]
    fields = ", ".join(KLIPPER.format(x.lower(), *one) for x, one in main.items())
    axes = "XYZ" if "Z" in main else "XY"
    hertz = " ".join(f"{main[x][0]:.1f}" if x in main else "0" for x in axes)
    damping = min(zeta for _, zeta in main.values())  # of all axes: what rings longest
    step = f"{STEP} {' '.join(axes)} --resonance-hz {hertz} --damping {damping:.3f}"
    return [*entries, Entry("Klipper", f"[input_shaper] {fields}"), next_step(step)]
