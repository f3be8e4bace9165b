import numba
import pytest

from jcontour._compiled import compiled


def doubled(x):
    return 2 * x


def test_compiles():
    assert compiled(doubled)(21) == 42


def test_without_a_place_for_the_cache_it_still_compiles(monkeypatch):
    plain = numba.njit

    def nowhere(*arguments, cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return plain(*arguments, **options)

    monkeypatch.setattr(numba, "njit", nowhere)
    assert compiled(doubled)(21) == 42


def test_other_failures_are_heard():
    with pytest.raises(Exception, match="callable|function|type"):
        compiled(3)
