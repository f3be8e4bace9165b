"""Where JAX computes."""

import jax

from jcontour import _devices as devices


def test_the_device_is_that_of_jax():
    assert devices.on_gpu() == (jax.default_backend() == "gpu")


def test_the_cpu_is_taken_beside_a_gpu(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert devices.on_gpu()
    with devices.on_cpu():
        assert not devices.on_gpu()
        assert jax.numpy.zeros(2).device == jax.local_devices(backend="cpu")[0]
    assert devices.on_gpu()
