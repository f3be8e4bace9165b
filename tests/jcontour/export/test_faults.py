"""What a streaming law does where something fails: the loop is closed around the C code."""

import numpy as np
import pytest

from jcontour.export.rendering import STATUSES, TRIPS

from .conftest import LIMIT, InC, code_of, controllers, needs_compiler

COUNT = 1e-6
STATUS = {name: k for k, name in enumerate(STATUSES)}
TRIP = {name: k for k, name in enumerate(TRIPS)}
pytestmark = needs_compiler


@pytest.fixture(scope="module")
def law(tmp_path_factory):
    return InC(code_of("contouring"), tmp_path_factory.mktemp("law"))


class Loop:
    """The table behind encoders with whole counts, its law, and the speed that was reached."""

    def __init__(self, law, place):
        self.law, (_, self.machine) = law, controllers()["contouring"]
        self.A, self.B, self.C = (
            np.asarray(one) for one in (self.machine.A, self.machine.B, self.machine.C)
        )
        self.x = np.asarray(self.machine.initial_state(np.asarray(place), np.zeros(2)))
        self.now, self.tick, self.u = 0, 0, np.zeros(2)
        self.speeds, self.changes, self.places, self.statuses = [], [], [], []
        law.restart()

    def sample(self, path, wrong=lambda y: y, late=0, **flags):
        """One call of the law, `late` samples too late."""
        for _ in range(late):
            self._moved()
        self.now += late
        y = np.round(self.C @ self.x / COUNT) * COUNT
        ahead = np.minimum(self.now + np.arange(12), len(path) - 1)
        self.tick += 1 + late
        before, self.u = self.u, self.law.step(path[ahead], wrong(y), tick=self.tick, **flags)
        self.changes.append(np.abs(self.u - before).max())
        self.now += self.law.take
        self.statuses.append(self.law.status)
        self._moved()

    def _moved(self):
        place = self.C @ self.x
        self.x = self.A @ self.x + self.B @ self.u
        self.speeds.append(np.abs(self.C @ self.x - place).max() / self.machine.dt)
        self.places.append(self.C @ self.x)


def square(feed, dt, side=4e-3, acceleration=2.0):
    """A square from rest to rest at every corner."""
    ramp = feed / acceleration
    whole = side / feed + ramp
    time = np.arange(0.0, whole, dt)
    rising, falling = np.minimum(time, ramp), np.maximum(time - (whole - ramp), 0.0)
    arc = acceleration * (rising**2 / 2 + ramp * np.maximum(time - ramp, 0) - falling**2 / 2)
    arc = np.append(np.minimum(arc, side), side)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * side + 0.013
    sides = [a + (b - a) * arc[:, None] / side for a, b in zip(corners, corners[1:], strict=False)]
    return np.concatenate(sides)


def distance(path, places):
    """Of every place from the nearest piece of the path."""
    a, along = path[:-1], np.diff(path, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-30)
    actual = []
    for place in np.atleast_2d(places):
        part = np.clip(((place - a) * along).sum(axis=1) / square, 0.0, 1.0)
        actual.append(np.linalg.norm(a + part[:, None] * along - place, axis=1).min())
    return np.array(actual)


@pytest.fixture(scope="module")
def path():
    return square(0.05, controllers()["contouring"][1].dt)


def test_a_run_without_faults_stays_on_the_path(law, path):
    loop = Loop(law, path[0])
    for _ in range(len(path) + 100):
        loop.sample(path)
    assert set(loop.statuses) == {STATUS["LAW_FOLLOWING"]}
    assert distance(path, loop.places).max() < 1e-5
    assert np.abs(loop.places[-1] - path[-1]).max() < 2e-6
    assert law.breaks == law.losses == law.missed == 0


def test_a_hold_stops_on_the_path_and_goes_on(law, path):
    loop = Loop(law, path[0])
    for k in range(len(path) + 800):
        loop.sample(path, hold=200 <= k < 700)
    held = np.array(loop.statuses) == STATUS["LAW_HELD"]
    assert held.sum() > 300
    still = np.flatnonzero(held)[50:]
    assert np.ptp(np.array(loop.places)[still], axis=0).max() < 3e-6
    assert distance(path, loop.places).max() < 1e-5
    assert np.abs(loop.places[-1] - path[-1]).max() < 2e-6 and law.breaks == 0


def test_five_millimetres_off_it_returns_at_the_speed_of_recovery(law, path):
    loop = Loop(law, path[0] + [5e-3, -5e-3])
    start = np.repeat(path[:1], 2000, axis=0)
    for _ in range(2000):
        loop.sample(start)
    recovery = code_of("contouring").limits.recovery_speed[0]
    assert 0.9 * recovery < max(loop.speeds) < 1.05 * recovery
    assert loop.statuses[0] == STATUS["LAW_RECOVERING"]
    assert loop.statuses[-1] == STATUS["LAW_FOLLOWING"]
    assert np.abs(loop.places[-1] - path[0]).max() < 2e-6
    assert loop.changes[0] < 0.05 * LIMIT  # bumpless: the command begins where the axes stand


def test_beyond_its_reach_it_is_not_enabled(law, path):
    loop = Loop(law, path[0] + [0.011, 0.0])
    loop.sample(path)
    assert (law.trip, law.status) == (TRIP["LAW_OUT_OF_REACH"], STATUS["LAW_TRIPPED"])
    assert np.all(loop.u == 0.0)
    loop.sample(path, enable=False)
    assert (law.trip, law.status) == (TRIP["LAW_NO_TRIP"], STATUS["LAW_OFF"])


FAULTS = {
    "jump": "LAW_FOLLOWING_ERROR",
    "far jump": "LAW_MEASUREMENT_LOST",
    "nan": "LAW_MEASUREMENT_LOST",
    "freeze": "LAW_MEASUREMENT_FROZEN",
    "leap": "LAW_REFERENCE",
    "late": "LAW_DEADLINE",
    "unknown point": "LAW_REFERENCE",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_that_stays_trips_by_its_name(law, path, fault):
    loop, path, frozen = Loop(law, path[0]), path.copy(), []
    if fault == "leap":
        path[500:] += 5e-3
    if fault == "unknown point":
        path[500] = np.nan
    for k in range(700):
        if law.status == STATUS["LAW_TRIPPED"]:
            break

        def wrong(y, k=k):
            if k < 400:
                return y
            frozen.append(y)
            sizes = {"jump": 2.5e-4, "far jump": 5e-3, "nan": np.nan}
            return frozen[0] if fault == "freeze" else y + sizes.get(fault, 0.0)

        loop.sample(path, wrong, late=4 if fault == "late" and k == 400 else 0)
    assert law.trip == TRIP[FAULTS[fault]]
    assert max(loop.speeds) < 4 * 0.05
    for _ in range(20):
        loop.sample(path)
    assert np.all(loop.u == 0.0) and law.trip == TRIP[FAULTS[fault]]  # it stays


def test_bridged_faults_are_counted(law, path):
    loop = Loop(law, path[0])
    for k in range(len(path) + 300):
        if k in (300, 500):
            loop.now += 3  # samples of the reference are lost
        loop.sample(path, lambda y, k=k: np.nan * y if 200 <= k < 204 else y, 2 * (k == 600))
    assert law.trip == TRIP["LAW_NO_TRIP"]
    assert (law.losses, law.missed) == (8, 2) and law.breaks > 0
    assert np.abs(loop.places[-1] - path[-1]).max() < 2e-6


def faulty_run(law, path, seed):
    """Faults of random kinds at random times; the loop, and whether it was off the path at last."""
    random = np.random.default_rng(seed)
    off = random.uniform(-5e-3, 5e-3, 2) if random.random() < 0.3 else np.zeros(2)
    loop, length = Loop(law, path[0] + off), len(path) + 2500
    faults = random.choice(["nan", "jump", "freeze", "skip", "late", "hold", "override"], 4)
    times = np.sort(random.integers(1, len(path), 4))
    lasting, amounts = random.integers(1, 300, 4), random.uniform(-1, 1, (4, 2))
    last, rates = None, np.ones(length)
    for time, name, lasts in zip(times, faults, lasting, strict=True):
        rates[time : time + lasts] = 0.5 if name == "override" else rates[time : time + lasts]
    rates = np.convolve(rates, np.full(60, 1 / 60), "same")  # as a planner changes its feed
    rates[:60] = 1.0
    read = np.minimum(np.cumsum(rates), len(path) - 1.0)
    rows = np.stack([np.interp(read, np.arange(len(path)), axis) for axis in path.T], axis=1)
    for k in range(length):
        live = {
            name: amounts[j]
            for j, name in enumerate(faults)
            if times[j] <= k < times[j] + (8 if name in ("nan", "jump") else lasting[j])
        }
        begins = [name for name, time in zip(faults, times, strict=True) if time == k]

        def wrong(y, live=live):
            nonlocal last
            if "jump" in live:
                y = y + 10.0 ** (-2 - 3 * abs(live["jump"][0])) * np.sign(live["jump"])
            if "nan" in live:
                y = y * np.nan
            if "freeze" in live and last is not None:
                y = last
            last = y
            return y

        if "skip" in begins:
            loop.now += int(random.integers(1, 8))
        late = int(random.integers(1, 6)) if "late" in begins else 0
        loop.sample(rows, wrong, late, hold="hold" in live)
        if law.status == STATUS["LAW_TRIPPED"] and not np.any(loop.u):
            break
    return loop


@pytest.mark.parametrize("batch", range(4))
def test_random_faults_end_on_the_path_or_in_a_named_trip(law, path, batch):
    """100 runs: never above the stated speed, control and increment."""
    limits, ends = code_of("contouring").limits, []
    for seed in range(25 * batch, 25 * batch + 25):
        loop = faulty_run(law, path, seed)
        assert max(loop.speeds) <= limits.speed[0] + 1e-9, seed
        assert np.abs(loop.u).max() <= LIMIT + 1e-9
        assert max(loop.changes) <= limits.increment[0] + 1e-9, seed
        if law.status == STATUS["LAW_TRIPPED"]:
            assert law.trip > 0
        else:
            assert np.abs(loop.places[-1] - path[-1]).max() < 5e-6, seed
        ends.append(law.trip)
    assert len(set(ends)) > 2  # some go on, some trip, for several reasons
