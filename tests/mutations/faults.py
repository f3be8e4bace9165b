"""Forty small faults in the mathematics: the text, what it becomes, and the nearest tests."""

import re
from typing import NamedTuple

LIBRARY = "tests/jcontour"


class Fault(NamedTuple):
    """One fault: `text` occurs exactly once in `file`, whatever its line breaks."""

    file: str
    text: str
    becomes: str
    tests: str  # the file or folder that is nearest

    def put_into(self, source: str) -> str:
        """The source with the fault in it.

        Raises:
            ValueError: the text does not occur exactly once.
        """
        tokens = re.findall(r"\w+|[^\w\s]", self.text)
        pattern = re.compile(r"\s*".join(map(re.escape, tokens)))
        count = len(pattern.findall(source))
        if count != 1:
            raise ValueError(f"{self.file}: {self.text!r} occurs {count} times, needs exactly one")
        return pattern.sub(lambda _: self.becomes, source)


FAULTS = (
    # geometry
    Fault(
        "jcontour/geometry/pieces.py",
        "acceleration - rate**2 * wave",
        "acceleration + rate**2 * wave",
        f"{LIBRARY}/geometry/test_contour.py",
    ),
    Fault(
        "jcontour/geometry/contour.py",
        "begin, end = arc - reach, arc + reach",
        "begin, end = arc, arc + reach",
        f"{LIBRARY}/geometry/test_contour.py",
    ),
    Fault(
        "jcontour/geometry/toolpath_rules.py",
        "INCH = 25.4e-3",
        "INCH = 24.5e-3",
        f"{LIBRARY}/geometry/test_gcode.py",
    ),
    # motion
    Fault(
        "jcontour/motion/point_to_point.py",
        "p.acceleration[i] / 2 + t * p.jerk[i] / 6",
        "p.acceleration[i] / 2 + t * p.jerk[i] / 3",
        f"{LIBRARY}/motion/test_point_to_point.py",
    ),
    Fault(
        "jcontour/motion/input_shaping.py",
        "jnp.stack([jnp.ones_like(K), 2 * K, K**2])",
        "jnp.stack([jnp.ones_like(K), 2 * K, K])",
        f"{LIBRARY}/motion/test_input_shaping.py",
    ),
    Fault(
        "jcontour/motion/feed_laws.py",
        "along_bisector * deviation * sin_half",
        "along_bisector * deviation",
        f"{LIBRARY}/motion/test_feed_laws.py",
    ),
    Fault(
        "jcontour/motion/references.py",
        "arc[-1] - arc[-2]",
        "arc[-2] - arc[-1]",
        f"{LIBRARY}/motion/test_references.py",
    ),
    # linear
    Fault(
        "jcontour/linear/transformations.py",
        "jsl.expm(block * dt)",
        "jsl.expm(-block * dt)",
        f"{LIBRARY}/linear",
    ),
    Fault(
        "jcontour/linear/velocity_form.py",
        ".set(C @ B)",
        ".set(C @ A @ B)",
        f"{LIBRARY}/linear/test_velocity_form.py",
    ),
    Fault(
        "jcontour/linear/plant.py",
        "@ Sy.T + increment",
        "@ Sy.T - increment",
        f"{LIBRARY}/linear/test_plant.py",
    ),
    # riccati
    Fault(
        "jcontour/riccati/receding_horizon.py",
        "_apply(closed.mT, cost.g) - _apply(C.mT",
        "_apply(closed.mT, cost.g) + _apply(C.mT",
        f"{LIBRARY}/riccati",
    ),
    Fault(
        "jcontour/riccati/receding_horizon.py",
        "first_control(at(models, 0), R, first)",
        "first_control(at(models, 1), R, first)",
        f"{LIBRARY}/controllers/lq/test_scheduled_lq.py",
    ),
    Fault(
        "jcontour/riccati/algebraic.py",
        "G + AW @ G @ A_k.T",
        "G + AW @ G @ AW.T",
        f"{LIBRARY}/riccati",
    ),
    # kernels
    Fault(
        "jcontour/kernels/sweeps/window_sweep.py",
        "-gains.first[:, -1].T",
        "gains.first[:, -1].T",
        f"{LIBRARY}/kernels/sweeps/test_window_sweep.py",
    ),
    Fault(
        "jcontour/kernels/sweeps/sliding_window.py",
        "error[:, n:] - y_d[:, None]",
        "error[:, n:] + y_d[:, None]",
        f"{LIBRARY}/kernels/sweeps/test_sliding_window.py",
    ),
    # controllers
    Fault(
        "jcontour/controllers/lq/contouring_lq.py",
        "(alpha + beta) * identity - beta *",
        "(alpha + beta) * identity + beta *",
        f"{LIBRARY}/controllers/lq/test_contouring_lq.py",
    ),
    Fault(
        "jcontour/controllers/lq/contouring_lq.py",
        "motion.state(end, end - before)",
        "motion.state(end, before - end)",
        f"{LIBRARY}/controllers/lq/test_contouring_lq.py",
    ),
    Fault(
        "jcontour/controllers/feedback/cascade.py",
        "gains.velocity * self.dt / gains.integral_time",
        "gains.velocity / gains.integral_time",
        f"{LIBRARY}/controllers/feedback/test_cascade.py",
    ),
    Fault(
        "jcontour/controllers/contouring/path_frame.py",
        "self.normal + self.curvature * error / 2",
        "self.normal + self.curvature * error",
        f"{LIBRARY}/controllers/contouring",
    ),
    Fault(
        "jcontour/controllers/wrappers/filters.py",
        "2 * (q0 - q2 * c**2)",
        "2 * (q0 + q2 * c**2)",
        f"{LIBRARY}/controllers/wrappers/test_filters.py",
    ),
    # observers
    Fault(
        "jcontour/controllers/observers/kalman.py",
        "self.model.step(filtered, control + disturbance)",
        "self.model.step(filtered, control - disturbance)",
        f"{LIBRARY}/controllers/observers/test_kalman.py",
    ),
    Fault(
        "jcontour/controllers/observers/disturbance_observer.py",
        "-2 * x - low_pass * control",
        "-x - low_pass * control",
        f"{LIBRARY}/controllers/observers/test_disturbance_observer.py",
    ),
    Fault(
        "jcontour/controllers/observers/extended_state_observers.py",
        "T**2 / 2 * nn",
        "T**2 * nn",
        f"{LIBRARY}/controllers/observers/test_extended_state_observers.py",
    ),
    Fault(
        "jcontour/controllers/observers/reduced_observer.py",
        "model.A[q:, q:] - gain @ model.A[:q, q:]",
        "model.A[q:, q:] + gain @ model.A[:q, q:]",
        f"{LIBRARY}/controllers/observers/test_reduced_observer.py",
    ),
    # plants
    Fault(
        "jcontour/plants/friction.py",
        "self.stribeck / (1 + (speed / self.stribeck_speed) ** 2)",
        "self.stribeck / (1 + jnp.abs(speed / self.stribeck_speed))",
        f"{LIBRARY}/plants/flexible_axis/test_axis.py",
    ),
    Fault(
        "jcontour/plants/integrators.py",
        "p + 2 * q + 2 * r + s",
        "p + 2 * q + r + 2 * s",
        f"{LIBRARY}/plants/test_integrators.py",
    ),
    Fault(
        "jcontour/plants/gantry/gantry.py",
        "M_e * (2 * dx * omega * cosine",
        "M_e * (dx * omega * cosine",
        f"{LIBRARY}/plants/gantry/test_gantry.py",
    ),
    Fault(
        "jcontour/plants/gantry/parameters.py",
        "(self.half_span**2 + self.half_width**2) / 3",
        "(self.half_span**2 + self.half_width**2) / 12",
        f"{LIBRARY}/plants/gantry/test_parameters.py",
    ),
    Fault(
        "jcontour/plants/wrappers/delays.py",
        "jnp.concatenate([control[None], line])[self.samples]",
        "jnp.concatenate([control[None], line])[self.samples - 1]",
        f"{LIBRARY}/plants/wrappers",
    ),
    # qp and mpc
    Fault(
        "jcontour/qp/lanes/sweeps.py",
        "ahead - dot(zip(Y, pulled[b], strict=True))",
        "ahead + dot(zip(Y, pulled[b], strict=True))",
        f"{LIBRARY}/qp/test_lanes_on_cpu.py",
    ),
    Fault(
        "jcontour/qp/problem.py",
        "gap += z[i] * (Hz + g[i])",
        "gap += z[i] * (Hz - g[i])",
        f"{LIBRARY}/qp",
    ),
    Fault(
        "jcontour/mpc/tracking/condense.py",
        "np.diff(Fa, 2, axis=0) / model.dt**2",
        "np.diff(Fa, 2, axis=0) / model.dt",
        f"{LIBRARY}/mpc/tracking/test_condense.py",
    ),
    Fault(
        "jcontour/mpc/tracking/condense.py",
        "states : states + inputs] = -np.eye(inputs)",
        "states : states + inputs] = np.eye(inputs)",
        f"{LIBRARY}/mpc/tracking/test_condense.py",
    ),
    Fault(
        "jcontour/mpc/contouring/contouring_qp.py",
        "H[c + 1, c] -= 2 * change[c + 1]",
        "H[c + 1, c] += 2 * change[c + 1]",
        f"{LIBRARY}/mpc/contouring/test_contouring_qp.py",
    ),
    # metrics
    Fault(
        "jcontour/simulation/metrics.py",
        "pairs = mask[1:] & mask[:-1]",
        "pairs = mask[1:]",
        f"{LIBRARY}/simulation/test_metrics.py",
    ),
    Fault(
        "jcontour/simulation/metrics.py",
        "jnp.maximum(jnp.sum(mask), 1)",
        "square.shape[0]",
        f"{LIBRARY}/simulation/test_metrics.py",
    ),
    # analysis
    Fault(
        "jcontour/analysis/frozen_loops.py",
        "self.A + (self.B * gains) @ self.C",
        "self.A + self.B @ self.C",
        f"{LIBRARY}/analysis/test_stability.py",
    ),
    # tuning
    Fault(
        "tuning/point.py",
        "np.exp(np.mean(np.log(largest)))",
        "np.exp(np.max(np.log(largest)))",
        "tests/tuning/test_point.py",
    ),
    Fault(
        "tuning/descents/quadratic_step.py",
        "room = np.repeat(np.max(model.errors, axis=1), v) - model.errors.ravel()",
        "room = np.repeat(np.max(model.errors, axis=1), v) + model.errors.ravel()",
        "tests/tuning/descents/test_quadratic_step.py",
    ),
    Fault(
        "tuning/descents/descent.py",
        "return objective + step.prices @ model.limit_slopes",
        "return objective - step.prices @ model.limit_slopes",
        "tests/tuning/descents/test_descent.py",
    ),
    Fault(
        "tuning/tune.py",
        "best = min(rows, key=rank)",
        "best = rows[-1]",
        "tests/tuning/test_tune.py",
    ),
    Fault(
        "tuning/parameters.py",
        "place / (1 - place)",
        "place / (1 + place)",
        "tests/tuning/test_parameters.py",
    ),
    Fault(
        "tuning/identification/estimates.py",
        "(1 + CONFIDENCE) / 2",
        "CONFIDENCE",
        "tests/tuning/identification/test_estimates.py",
    ),
)
