"""Where JAX computes, and with what numbers."""

import jax
import numpy as np

from jcontour import devices


def test_the_device_is_that_of_jax():
    assert devices.on_gpu() == (jax.default_backend() == "gpu")


def test_the_cpu_is_taken_beside_a_gpu(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert devices.on_gpu()
    with devices.on_cpu():
        assert not devices.on_gpu() and devices.suits_native(np.zeros(2))
        assert jax.numpy.zeros(2).device == jax.local_devices(backend="cpu")[0]
    assert devices.on_gpu()


def test_numbers_of_one_type():
    assert devices.number_size(np.zeros(2)) == 8
    assert devices.number_size([np.zeros(2, np.float32)]) == 4
    assert devices.number_size([np.zeros(2), np.zeros(2, np.float32)]) is None
    assert devices.number_size(np.zeros(2, int)) is None


def test_loops_for_the_cpu_take_float64_there_alone(monkeypatch):
    monkeypatch.setattr(devices, "platform", lambda: "cpu")
    assert devices.suits_native(np.zeros(2))
    assert not devices.suits_native(np.zeros(2, np.float32))
    for other in ("gpu", "tpu"):
        monkeypatch.setattr(devices, "platform", lambda name=other: name)
        assert not devices.suits_native(np.zeros(2))
