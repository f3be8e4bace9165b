"""How much a run of the tuner may try."""

from dataclasses import dataclass

MANY = 16  # scattered points for which a program of the values alone is worth compiling


@dataclass(frozen=True)
class Effort:
    """How much a run may try: `QUICK`, `THOROUGH`, or numbers of your own.

    >>> from dataclasses import replace
    >>> replace(QUICK, seed=1).steps
    15

    Attributes:
        starts: descents, from the given weights first, then from promising scattered points.
        scatter: points evaluated after the first descent, a Sobol sequence around its best point.
        steps: of one descent; each evaluates one or two points.
        tolerance: relative gain of the objective that ends a descent when nothing promises more.
        spread: half width in ln(weight) of the box of the scattered points for up to two weights;
            with more it falls as the root of their number. Half of them fill a box of twice that.
        seed: of the Sobol sequence.
        every_start: whether every start is descended from; else a descent that ends stationary
            within the limits is the last one.
        evaluations: of a run, at most; it ends with the best that was found until then.

    Raises:
        ValueError: a number is below its least sensible value.
    """

    starts: int
    scatter: int
    steps: int
    tolerance: float
    spread: float = 7.0  # three decades up and down
    seed: int = 0
    every_start: bool = True
    evaluations: int = 10_000  # starts and steps end a run before

    @property
    def values_alone(self) -> bool:
        """Whether scattered points are evaluated without slopes: many at a third of the cost."""
        return self.scatter >= MANY

    def __post_init__(self):
        """Check the ranges."""
        least = {"starts": 1, "scatter": 0, "spread": 0, "steps": 1, "seed": 0, "evaluations": 1}
        for name, bound in least.items():
            if getattr(self, name) < bound:
                raise ValueError(f"{name}: needs at least {bound}, received {getattr(self, name)}")
        if not self.tolerance > 0:
            raise ValueError(f"tolerance: needs to be above zero, received {self.tolerance}")


# a tenth of a per cent within a minute: less than a plant model is good for
QUICK = Effort(starts=2, scatter=6, steps=15, tolerance=1e-3, every_start=False)
# for publication; a descent rarely needs half of these steps, and most runs of two weights end
# before so many evaluations
THOROUGH = Effort(starts=10, scatter=32, steps=60, tolerance=1e-5, evaluations=400)
