"""Integration of a machine's equation of motion over one step of time."""

import jax


def runge_kutta(rates, x, h: float):
    """One classical step of fourth order; `rates` may be any function from a state to its time derivative."""

    def ahead(slope, part: float):
        return jax.tree.map(lambda a, b: a + part * h * b, x, slope)

    k1 = rates(x)
    k2 = rates(ahead(k1, 0.5))
    k3 = rates(ahead(k2, 0.5))
    k4 = rates(ahead(k3, 1.0))
    return jax.tree.map(
        lambda a, p, q, r, s: a + h / 6 * (p + 2 * q + 2 * r + s), x, k1, k2, k3, k4
    )
