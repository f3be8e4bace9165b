"""A sweep that is asked for: machine, contours, previews and the values of weights."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Array, Float

from jcontour.app.catalogue.choices import UnreadFlagWarning, design_for, job_named, machine_named
from jcontour.app.designs.design import Design, with_values
from jcontour.app.flags.tuning import Sweep
from jcontour.app.jobs.job import Pace, Task
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import named_numbers
from jcontour.app.runs.tuning.limits import loop_limits, named_limits, noise_limit
from tuning.sweeps import grid, random_sample

Listed = dict[str, tuple[float, ...]]
FACTORS, VARIED = (0.1, 0.3, 1.0, 3.0, 10.0), 2  # of the first weights, where none are named
# of weights of a cost: on the contours of bridgeport a tenth to a thousand times them are the best
COST_FACTORS = (1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)


def listed_values(words: Sequence[str]) -> Listed:
    """Values by name of NAME=VALUE,VALUE,... words.

    Raises:
        ValueError: words of another form, or a number that is not finite.
    """
    return dict(named_numbers("vary", one) for one in words)


def sampled_designs(
    varied: Mapping[str, Sequence[float]], samples: int, seed: int
) -> dict[str, Float[Array, " D"]]:
    """The grid of all values, or so many random designs where `samples` is above zero.

    A random sample lies between the least value and the largest, even in the logarithm.

    Raises:
        ValueError: fewer than zero samples, or a random sample from values that are not all above
            zero.
    """
    if samples < 0:
        raise ValueError(f"samples: needs at least 0, received {samples}")
    if not samples:
        return grid(**varied)
    for name, values in varied.items():
        if min(values) <= 0:
            raise ValueError(
                f"vary: a random sample needs values above zero, for it is even in the logarithm; "
                f"received {min(values):g} for {name}: give a lower end above zero, or a grid "
                "without --samples"
            )
    ends = {name: (min(values), max(values)) for name, values in varied.items()}
    return random_sample(samples, seed, **ends)


@dataclass(frozen=True)
class Swept:
    """A sweep that is asked for.

    Attributes:
        flags: with the previews that make different controllers.
        values: of the weights that vary, one entry per design.
    """

    flags: Sweep
    machine: Machine
    jobs: list[Task]
    values: dict[str, Float[Array, " D"]]
    _designs: dict[int, Design] = field(default_factory=dict, init=False, repr=False, compare=False)

    def design(self, preview: int) -> Design:
        """The controller with a preview, its weights open; its first loop is found once."""
        if preview not in self._designs:
            self._designs[preview] = _design(self.flags, self.machine, preview)
        return self._designs[preview]

    def scenarios(self, design: Design) -> Scenarios:
        """The contours and the true machines, for a controller with its preview."""
        seen = [True] * len(self.jobs)
        return Scenarios.of(self.jobs, seen, self.machine, design.fed, design.preview)

    @property
    def count(self) -> int:
        """Designs for every preview."""
        return next(iter(self.values.values())).size


def swept_of(flags: Sweep) -> Swept:
    """The sweep that flags describe.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
    _check_flags(flags)
    for limits in (named_limits, loop_limits):  # they refuse what is no limit
        limits(flags)
    machine = machine_named(flags.plant)
    pace = Pace.of(flags, machine)
    jobs = [job_named(name, pace) for name in flags.parts or machine.usual.swept]
    values = sampled_values(flags, design_for(machine, flags).tunable())
    asked = Swept(replace(flags, previews=horizons(flags, machine)), machine, jobs, values)
    noise_limit(flags, machine, asked.design(flags.previews[0]))
    _check(asked)
    return asked


def sampled_values(flags: Sweep, design: Design) -> dict[str, Float[Array, " D"]]:
    """Values of the weights that vary: a grid, or a random sample.

    Raises:
        ValueError: nothing to sweep, or a value is wrong.
    """
    if not flags.previews:
        raise ValueError("previews: need at least one")
    varied = listed_values(flags.vary) or around_start(design)
    return sampled_designs(varied, flags.samples, flags.seed)


def around_start(design: Design) -> dict[str, tuple[float, ...]]:
    """Factors around the start of the first free weights, more decades of weights of a cost.

    Only weights count that are one positive number, equal on all axes.

    Raises:
        ValueError: there is no such weight.
    """
    starts = {}
    for name in design.free():
        starts[name] = np.unique(np.asarray(design.start[name], float))
    single = {}
    for name, values in starts.items():
        if values.size == 1 and values[0] > 0:
            single[name] = float(values[0])
    if not single:
        raise ValueError(
            f"vary: {design.name} has no weight that is one positive number; "
            f"name some of {', '.join(starts)} with their values"
        )
    found = {}
    for name in list(single)[:VARIED]:
        factors = COST_FACTORS if name in design.costs else FACTORS
        found[name] = tuple(factor * single[name] for factor in factors)
    return found


def horizons(flags: Sweep, machine: Machine) -> tuple[int, ...]:
    """Previews that make different controllers: all of them for LQ, one for a cascade."""
    previews = [_design(flags, machine, preview).preview for preview in flags.previews]
    return tuple(dict.fromkeys(previews))


def _check_flags(flags: Sweep) -> None:
    if flags.preview != Sweep.preview:
        raise ValueError("preview: a sweep has --previews, for one or several")


def _check(asked: Swept) -> None:
    """Refuse names, values and parts that do not fit before anything is written."""
    for preview in asked.flags.previews:
        design = asked.design(preview)
        known = design.start
        unknown = [name for name in asked.values if name not in known]
        if unknown:
            raise ValueError(
                f"vary: {design.name} has no weight {unknown[0]!r}; name some of {', '.join(known)}"
            )
        first = {name: column[0] for name, column in asked.values.items()}
        design.build(with_values(design.start, first))
        for job in asked.jobs:
            job.reference(asked.machine.model.dt, design.preview)


def _design(flags: Sweep, machine: Machine, preview: int) -> Design:
    """The controller with a preview; without a word where it has none: nobody gave it one."""
    flags = replace(flags, preview=preview)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnreadFlagWarning)
        return design_for(machine, flags).tunable()
