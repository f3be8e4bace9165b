"""Filters that see the reference ahead of time.

    out(k) = [numerator(lambda) / denominator(lambda)] r(k + preview)

Before its first sample the reference was in the steady motion of its start. The filter has been
running since: its answer to that motion is exact, only the rest is filtered.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.motion.references import Reference


class PreviewFilter(eqx.Module):
    """A stable filter, the same for every axis or one for each; traceable in its coefficients.

    >>> ahead = PreviewFilter([1.0], [1.0], preview=2)
    >>> ahead.filtered(jnp.arange(5.0)[:, None], jnp.ones(1))[:, 0].tolist()
    [2.0, 3.0, 4.0]

    Args:
        numerator: (c,) or (m, c), ascending in lambda = z^-1.
        denominator: (d,) or (m, d), ascending; the first coefficient is not zero.
        preview: samples that it looks ahead.

    Raises:
        ValueError: a coefficient is not finite, the filter is not stable, or the preview is
            negative.
    """

    numerator: Float[Array, "*m c"]
    denominator: Float[Array, "*m d"]
    preview: int = eqx.field(static=True)

    def __init__(self, numerator, denominator, preview: int):
        self.numerator = jnp.asarray(numerator, float)
        self.denominator = jnp.asarray(denominator, float)
        self.preview = int(preview)
        if self.preview < 0:
            raise ValueError(f"preview: cannot be negative, received {preview}")
        if is_concrete(self.numerator, self.denominator):
            for row in np.atleast_2d(np.asarray(self.denominator)):
                _check_stable(row)
            if not np.isfinite(np.asarray(self.numerator)).all():
                raise ValueError("numerator: every coefficient needs to be finite")

    def of(self, reference: Reference) -> Float[Array, "T m"]:
        """Filtered positions of the T control steps.

        Raises:
            ValueError: the reference has fewer preview samples than the filter.
        """
        self._check_preview(reference)
        last = reference.steps + self.preview
        return self.filtered(reference.position[:last], reference.start_increment)

    def before_and_of(self, reference: Reference) -> Float[Array, "both m"]:
        """Filtered positions from `preview` samples before the first control step on.

        Raises:
            ValueError: as `of`.
        """
        self._check_preview(reference)
        last = reference.steps + self.preview
        return self._whole(reference.position[:last], reference.start_increment)

    def filtered(
        self, samples: Float[Array, "S m"], increment: Float[Array, " m"]
    ) -> Float[Array, "S-{self.preview} m"]:
        """Filtered samples; `increment` is their motion per sample before the first."""
        return self._whole(samples, increment)[self.preview :]

    def _whole(
        self, samples: Float[Array, "S m"], increment: Float[Array, " m"]
    ) -> Float[Array, "S m"]:
        """The same from `preview` samples before the first on."""
        top, below = self._rows(samples.shape[1])
        count = jnp.arange(samples.shape[0], dtype=samples.dtype)[:, None]
        steady = samples[:1] + count * increment[None]
        out = self._steady(top, below, samples[0], increment, count)
        return out + causal(top, below, samples - steady)

    def _check_preview(self, reference: Reference) -> None:
        if reference.preview < self.preview:
            raise ValueError(
                f"preview: the filter looks {self.preview} samples ahead, "
                f"the reference was made with {reference.preview}"
            )

    def _rows(self, axes: int) -> tuple[Float[Array, "m c"], Float[Array, "m d"]]:
        """Numerator and denominator of every axis."""
        found = (self.numerator, self.denominator)
        top, below = (jnp.broadcast_to(one, (axes, one.shape[-1])) for one in found)
        return top, below

    def _steady(self, top, below, start, increment, count) -> Float[Array, "S m"]:
        """Answer to the steady motion start + k increment: H(1) r - H'(1) dr."""
        gain, slope = _at_one(top, below)
        return gain[None] * (start[None] + count * increment[None]) - (slope * increment)[None]


def causal(
    numerator: Float[Array, "m c"], denominator: Float[Array, "m d"], samples: Float[Array, "S m"]
) -> Float[Array, "S m"]:
    """Filter from rest, sample by sample in the transposed direct form."""
    order = max(numerator.shape[1], denominator.shape[1], 2)

    def padded(rows: Array) -> Float[Array, "o m"]:
        scaled = rows / denominator[:, :1]
        return jnp.pad(scaled, ((0, 0), (0, order - rows.shape[1]))).T

    b, a = padded(numerator), padded(denominator)

    def step(memory, sample):
        out = b[0] * sample + memory[0]
        later = jnp.concatenate([memory[1:], jnp.zeros_like(memory[:1])])
        return later + b[1:] * sample[None] - a[1:] * out[None], out

    rest = jnp.zeros((order - 1, samples.shape[1]), samples.dtype)
    return jax.lax.scan(step, rest, samples)[1]


def _at_one(top, below) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Gain and derivative of a ratio of polynomials at lambda = 1."""
    values = []
    for rows in (top, below):
        powers = jnp.arange(rows.shape[1], dtype=rows.dtype)
        values += [jnp.sum(rows, axis=1), rows @ powers]
    n, dn, d, dd = values
    return n / d, (dn * d - n * dd) / d**2


def _check_stable(denominator: np.ndarray) -> None:
    poles = np.abs(np.roots(denominator)) if denominator[0] else np.array([np.inf])
    if not (np.isfinite(denominator).all() and np.all(poles < 1)):
        raise ValueError(
            f"denominator: the filter is not stable, its poles in z are {np.round(poles, 6)}"
        )
