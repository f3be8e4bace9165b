from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.simulation.devices import Spread, device_mesh

TWO = Spread(device_mesh(2))


@pytest.mark.parametrize("members", [1, 2, 5, 8])
def test_every_member_comes_back_in_its_place(members):
    """Also where the devices do not divide the batch; x + i for a tree of two leaves."""
    batch = np.arange(members * 3.0).reshape(members, 3), np.arange(1.0 * members)
    actual = jax.jit(lambda b: TWO(lambda one: {"sum": one[0].sum() + one[1], "index": one[1]}, b))(
        batch
    )
    np.testing.assert_array_equal(actual["index"], np.arange(members))
    np.testing.assert_allclose(actual["sum"], 10.0 * np.arange(members) + 3, rtol=1e-15)


def test_both_devices_work():
    shares = (
        jax.jit(lambda x: TWO(lambda one: one * 2, x)).lower(np.arange(8.0)).compile().as_text()
    )
    assert "f64[4]" in shares and "num_partitions=2" in shares


def test_gradient_reaches_what_all_members_share():
    """The slope of sum sin(w x_i) is sum x_i cos(w x_i).

    A copy that fills the batch up adds nothing.
    """
    x = np.array([0.3, -1.0, 2.0, 0.7, 1.1])
    slope = jax.jit(jax.grad(lambda w: jnp.sum(TWO(lambda one: jnp.sin(w * one), x))))(0.8)
    np.testing.assert_allclose(slope, np.sum(x * np.cos(0.8 * x)), rtol=1e-14)


def test_counts():
    assert device_mesh().size == 2 and device_mesh(1).size == 1
    assert Spread(device_mesh(2)) == TWO and hash(Spread(device_mesh(2))) == hash(
        TWO
    )  # or every call compiles anew
    for count in (0, 3):
        with pytest.raises(ValueError, match=f"devices: needs 1 to 2, .* received {count}"):
            device_mesh(count)


@dataclass(frozen=True)
class Device:
    """One of many, as JAX tells it apart."""

    process_index: int
    id: int


def test_hosts_of_different_size_give_as_many_devices_each(monkeypatch):
    owners = [0, 0, 0, 1, 1]  # three devices on one host, two on the other
    devices = [Device(host, i) for i, host in enumerate(owners)]
    monkeypatch.setattr(jax, "devices", lambda: devices)
    assert [device.id for device in device_mesh(2).devices] == [0, 1, 3, 4]
    assert device_mesh().size == 5
    with pytest.raises(ValueError, match="devices: needs 1 to 2, .* received 3"):
        device_mesh(3)
