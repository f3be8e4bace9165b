"""A grid over two weights at once: which pairs are accurate, and which need little control."""

import jax.numpy as jnp

from jcontour import contours, feed_laws, references, stack_plants, stack_references
from jcontour.controllers import ContouringLQ, LQWeights
from jcontour.plants import bridgeport
from tuning import grid, sweep

model = bridgeport()
circle = contours.circle(1e-3)  # [m]
arc = feed_laws.constant_feed(circle, 0.05, model.dt)  # 0.05 m/s
reference = references.along(circle, arc, model.dt, preview=10, at_rest=False)


def build(weights):
    return ContouringLQ(model, weights, preview=10)


alphas, betas = (0.5, 1.0, 2.0, 4.0), (0.0, 5.0, 20.0)
designs = LQWeights(**grid(alpha=alphas, beta=betas), rho=jnp.full(12, 2e-9))
metrics = sweep(build, designs, stack_plants([model]), stack_references([reference]))
table = 1e6 * metrics.rms_contour_error[:, 0, 0].reshape(len(alphas), len(betas))  # [um]

print("alpha   " + "  ".join(f"beta {beta:4.0f}" for beta in betas) + "   (contour error, um)")
for alpha, row in zip(alphas, table, strict=True):
    print(f"{alpha:5.1f}   " + "  ".join(f"{error:9.3f}" for error in row))
best = int(jnp.argmin(table))
print(
    f"The best of {table.size} designs has alpha {alphas[best // 3]} and beta {betas[best % 3]}: "
    f"an RMS contour error of {jnp.min(table):.3f} um."
)
