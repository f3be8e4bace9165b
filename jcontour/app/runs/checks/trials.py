"""Trials of a loop: margins along its paths, random plants, an offset, standstill on counts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._devices import on_cpu
from jcontour.analysis.sensitivity import LoopPeaks, probe_samples
from jcontour.analysis.stability import DELAY_SEARCH, GAIN_SEARCH, Margins, margins
from jcontour.app.files.results.tuned_result import LostFirst, PathMargins, RobustTest, Standstill
from jcontour.app.jobs.replays import Scenarios, prepared_plans
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.runs.tuning.limits import measured_peak
from jcontour.app.runs.tuning.problem import stated_axis_limits
from jcontour.controller import Controller, Plan
from jcontour.geometry.contours import line
from jcontour.motion import Reference, along
from jcontour.plant import Plant
from jcontour.simulation import evaluate, stack_plants, stack_references
from jcontour.simulation.closed_loop import follow, prepared
from jcontour.simulation.evaluation import member, platform_batching
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use
from jcontour.simulation.metrics import Metrics, score_signals

OFFSET = 1e-6  # [m], so small that no limit of a drive is met
BETWEEN = (0.15, 0.3, 0.45)  # counts from the nearest one to the place that is held
SAMPLES = 1500  # that it is held
SETTLED = 500  # samples that do not count
PROBES = 16  # loops per contour: they change with direction, bend and place of the path, slowly
MEMBERS = 1000
SIDE_BY_SIDE = 100  # plants that are stepped together: fast on a CPU, little memory


def offset_lasts(plant: Plant, controller: Controller, reference: Reference) -> float:
    """Samples in which an offset of the tool dies out to a third.

        n = -T / ln r,   r = max_i |y^(i)(T) - y(T)| / delta

    y^(i) is the run of T samples that begins delta = `OFFSET` off the path in direction i, y the
    one that begins on it. Infinite where nothing of it dies out.
    """
    ends = np.asarray(_ends(plant, controller, prepared(controller, reference), reference))
    left = float(np.linalg.norm(ends[1:] - ends[0], axis=1).max()) / OFFSET
    if not left < 1:
        return np.inf
    return -reference.steps / float(np.log(left)) if left > 0 else 0.0


@eqx.filter_jit
def _ends(plant: Plant, controller: Controller, plan, reference: Reference) -> Float[Array, "r m"]:
    """Where runs end that begin on the path, and off it in every direction [m]."""
    begin = reference.position[0]
    offsets = OFFSET * jnp.concatenate([jnp.zeros((1, begin.size)), jnp.eye(begin.size)])

    def end(offset: Float[Array, " m"]) -> Float[Array, " m"]:
        state = plant.initial_state(begin + offset, reference.start_increment)
        rollout = follow(plant, controller, plan, reference, state)
        return plant.output(rollout.final_state)

    return jax.vmap(end)(offsets)


def standstill(controller: Controller, machine: Machine, fed: Fed) -> Standstill | None:
    """Worst of places and family; None where nothing is counted."""
    if machine.resolution is None or fed == "state":
        return None
    places = [_held(machine, part * machine.resolution, controller.preview) for part in BETWEEN]
    family = stack_plants(machine.frictionless.true_family(fed))
    metrics = evaluate(family, controller, stack_references(places), (SETTLED, SAMPLES))
    return Standstill(
        rms_control=float(np.max(metrics.rms_control)),
        rms_increment=float(np.max(metrics.rms_increment)),
    )


def _held(machine: Machine, offset: float | np.ndarray, preview: int) -> Reference:
    place = np.broadcast_to(offset, len(machine.axes))
    path = line(place, place + 1e-3)
    return along(path, np.zeros(SAMPLES), machine.model.dt, preview, at_rest=True)


@on_cpu()  # few and small
def path_margins(
    controller: Controller,
    machine: Machine,
    scenarios: Scenarios,
    fed: Fed,
    peaks: LoopPeaks,
) -> PathMargins:
    """Spectral radius, gain and delay margins over the training paths, and peak sensitivities.

    Every path is probed at up to `PROBES` of its scored samples.
    """
    plant = machine.nominal(fed)
    names = [job.name for job in scenarios.jobs_seen(True)]
    trained = np.flatnonzero(scenarios.training).tolist()
    references = jax.device_get(scenarios.references)
    paths = [_thinned(member(references, k)) for k in trained]
    each = [margins(plant, controller, path) for path in paths]
    open_loops = np.array([one.saturated for one in each])
    without = open_loops == np.array([np.sum(path.mask) for path in paths])
    gains = np.stack([one.gain for one in each])
    low, high = gains[:, :, 0].max(axis=0), gains[:, :, 1].min(axis=0)
    largest = {
        "sensitivity": float(np.max(peaks.sensitivity)),
        "complementary": float(np.max(peaks.complementary)),
    }
    if machine.response_uncertainty is not None:
        largest["uncertainty"] = float(np.max(peaks.uncertainty))
    return PathMargins(
        spectral_radius=float(max(one.spectral_radius for one in each)),
        gain_range=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        gain_search=(1 / GAIN_SEARCH, GAIN_SEARCH),
        delay_samples=int(min(one.delay for one in each)),
        delay_search=DELAY_SEARCH,
        probes_per_contour=PROBES,
        probes_left_out=int(open_loops[~without].sum()),
        contours_without_margins=tuple(np.array(names)[without].tolist()),
        lost_first=lost_first(each, paths, names),
        measured=measured_peak(controller, machine, scenarios, fed),
        **{name: peak if np.isfinite(peak) else None for name, peak in largest.items()},
    )


def lost_first(
    margins_of_paths: list[Margins], paths: list[Reference], names: list[str]
) -> LostFirst | None:
    """Where the smallest gain margin is; None where all loops are lost at once, or none."""
    gains = np.stack([one.gain for one in margins_of_paths])
    samples = np.stack([one.gain_at for one in margins_of_paths])
    contour, index, side = np.unravel_index(np.argmin(np.abs(np.log(gains))), gains.shape)
    sample = samples[contour, index, side]
    if sample < 0:
        return None
    position = np.asarray(paths[contour].position)[sample]
    return LostFirst(names[contour], tuple(position.tolist()), int(index) + 1)


def _thinned(reference: Reference) -> Reference:
    """The same run with `PROBES` scored samples at most.

    All paths then have as many loops, and one program does for them.
    """
    kept = np.zeros(reference.mask.shape, bool)
    kept[probe_samples(reference, PROBES)] = True
    return eqx.tree_at(lambda r: r.mask, reference, kept)


def robust_test(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed, seed: int
) -> RobustTest | None:
    """Random plants, and the corners of the family, with all effects on every training contour.

    None for a family of one plant.
    """
    family = machine.random_family(MEMBERS, seed, fed)
    if family is None:
        return None
    jobs = scenarios.jobs_seen(True)
    dt, preview = scenarios.references.dt, scenarios.references.preview
    references = stack_references([job.reference(dt, preview) for job in jobs])
    plans = prepared_plans(controller, references)
    limits = stated_axis_limits(machine)
    metrics, uses = jax.device_get(_metrics(family, controller, references, plans, limits))
    errors = np.asarray(getattr(metrics, f"rms_{machine.error}_error"))  # (contour, member)
    lost = np.asarray(metrics.diverged)
    largest = np.where(lost, -1.0, errors)
    names = [one.name for one in machine.drawn(MEMBERS, seed)]
    contour, plant = np.unravel_index(np.argmax(largest), largest.shape)
    used = {
        name: np.where(lost, 0.0, getattr(uses, name))
        for name in uses._fields
        if getattr(limits, name) is not None
    }
    users = {name: np.unravel_index(np.argmax(one), one.shape) for name, one in used.items()}
    return RobustTest(
        members=MEMBERS,
        diverged=int(lost.any(axis=0).sum()),
        error=float(largest.max()),
        contour=jobs[contour].name,
        plant=names[plant],
        uses={name: float(one.max()) for name, one in used.items()},
        users={name: f"{jobs[c].name}, {names[k]}" for name, (c, k) in users.items()},
    )


@eqx.filter_jit
def _metrics(
    family: Plant,
    controller: Controller,
    references: Reference,
    plans: Plan,
    limits: AxisLimits,
) -> tuple[Metrics, LimitUse]:
    """Metrics and use of the machine's limits (contour, member)."""
    groups = jax.tree.map(lambda leaf: leaf.reshape(-1, SIDE_BY_SIDE, *leaf.shape[1:]), family)

    def on_contour(planned: tuple[Reference, Plan]) -> tuple[Metrics, LimitUse]:
        reference, plan = planned

        def on_plant(plant: Plant) -> tuple[Metrics, LimitUse]:
            run = follow(plant, controller, plan, reference)
            signals = run.output, run.control, reference
            return score_signals(*signals), limit_use(*signals, limits)

        grouped = jax.lax.map(jax.vmap(on_plant), groups)
        return jax.tree.map(lambda leaf: leaf.reshape(MEMBERS), grouped)

    return platform_batching()(on_contour, (references, plans))
