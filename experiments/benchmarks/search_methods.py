"""Searches without slopes that the tuner is measured against, each from a library of its own.

A method calls `measure` until that raises `Spent`. It works in the coordinates of the tuner, the
logarithms of positive weights, from a point z, within a box that is given by its lowest and its
highest corner.
"""

import warnings
from collections.abc import Callable
from itertools import count

import numpy as np
from jaxtyping import Float

Measure = Callable[[Float[np.ndarray, " d"]], float]  # what is made small
Box = Float[np.ndarray, "2 d"]
SearchMethod = Callable[[Measure, Float[np.ndarray, " d"], Box, int], None]


class Spent(Exception):
    """All evaluations are used up."""


def cma_es(measure: Measure, z: Float[np.ndarray, " d"], box: Box, seed: int) -> None:
    """CMA-ES (cmaes), restarted at random points of the box with twice the population."""
    from cmaes import CMA

    random = np.random.default_rng(seed)
    sigma = float(np.max(box[1] - box[0])) / 6
    population = None
    for restart in count():
        mean = z if restart == 0 else random.uniform(*box)
        search = CMA(mean, sigma, bounds=box.T, seed=seed + restart, population_size=population)
        while not search.should_stop():
            asked = [search.ask() for _ in range(search.population_size)]
            search.tell([(point, measure(point)) for point in asked])
        population = 2 * search.population_size


def tpe(measure: Measure, z: Float[np.ndarray, " d"], box: Box, seed: int) -> None:
    """Tree-structured Parzen estimator of all weights together (Optuna), the given point first.

    One for each weight alone, Optuna's default, is slower and finds less.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True)
    study = optuna.create_study(sampler=sampler)
    study.enqueue_trial({str(k): float(value) for k, value in enumerate(z)})
    while True:
        trial = study.ask()
        place = [trial.suggest_float(str(k), *map(float, side)) for k, side in enumerate(box.T)]
        study.tell(trial, measure(np.array(place)))


def nelder_mead(measure: Measure, z: Float[np.ndarray, " d"], box: Box, seed: int) -> None:
    """Nelder and Mead's simplex (SciPy), restarted at random points of the box."""
    from scipy.optimize import minimize

    random = np.random.default_rng(seed)
    side = (box[1] - box[0]) / 10
    place = z
    while True:
        inward = np.where(place + side > box[1], -side, side)
        first = place + np.concatenate([np.zeros((1, z.size)), np.diag(inward)])
        minimize(
            measure,
            place,
            method="Nelder-Mead",
            bounds=box.T,
            options={"initial_simplex": first, "xatol": 1e-3, "fatol": 1e-4, "maxiter": 10**6},
        )
        place = random.uniform(*box)


def sobol(measure: Measure, z: Float[np.ndarray, " d"], box: Box, seed: int) -> None:
    """Points of a scrambled Sobol sequence (SciPy)."""
    from scipy.stats.qmc import Sobol

    measure(z)
    points = Sobol(z.size, rng=seed)
    while True:
        for place in points.random(64):
            measure(box[0] + place * (box[1] - box[0]))


METHODS: dict[str, SearchMethod] = {
    "CMA-ES": cma_es,
    "TPE": tpe,
    "Nelder-Mead": nelder_mead,
    "Sobol": sobol,
}
PACKAGES = ("cmaes", "optuna")
