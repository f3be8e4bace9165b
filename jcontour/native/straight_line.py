"""Straight-line programs over eight lanes, written by arithmetic in Python: memory and loops.

Unlike Numba's, such a program costs no second of loading, and LLVM compiles it for this processor
in a tenth of a second. It suits long formulas over the non-zeros of a plant.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from llvmlite import ir

from jcontour.native.numbers import DOUBLE, INT, LANES, LONG, WIDTH, Number, value


class Row(NamedTuple):
    """Numbers of an argument, of a result or of memory, flat, as a program has them."""

    builder: ir.IRBuilder
    first: Any  # address of the numbers
    extents: Any = None  # their address
    rank: Any = None  # how many extents

    def lanes(self, place) -> Number:
        """Eight numbers side by side, from a place on."""
        return Number(self.builder, self.builder.load(self._at(place, LANES), align=8))

    def everywhere(self, place) -> Number:
        """The number at a place, in every lane."""
        empty = ir.Constant(LANES, ir.Undefined)
        one = self.builder.insert_element(empty, self.one(place), ir.Constant(INT, 0))
        zeros = ir.Constant(ir.VectorType(INT, WIDTH), [0] * WIDTH)
        return Number(self.builder, self.builder.shuffle_vector(one, empty, zeros))

    def one(self, place):
        """The number at a place."""
        return self.builder.load(self._at(place, DOUBLE))

    def write(self, place, number) -> None:
        """Write eight numbers from a place on."""
        self.builder.store(value(number), self._at(place, LANES), align=8)

    def write_one(self, place, number) -> None:
        """Write a number."""
        self.builder.store(number, self._at(place, DOUBLE))

    def extent(self, axis):
        """Extent of an axis."""
        axis = whole(axis) if isinstance(axis, int) else axis
        place = self.builder.add(self.extents, self.builder.mul(axis, whole(8)))
        return self.builder.load(self.builder.inttoptr(place, LONG.as_pointer()))

    def size(self):
        """How many numbers there are: the product of the extents."""

        def times(axis, carried):
            return [self.builder.mul(carried[0], self.extent(axis))]

        return counted(self.builder, self.rank, times, [whole(1)])[0]

    def _at(self, place, kind):
        place = whole(place) if isinstance(place, int) else place
        address = self.builder.add(self.first, self.builder.mul(place, whole(8)))
        return self.builder.inttoptr(address, kind.as_pointer())


def whole(number: int) -> ir.Constant:
    """A whole number that is known."""
    return ir.Constant(LONG, number)


def memory(builder: ir.IRBuilder, numbers: int) -> Row:
    """Room for so many times eight numbers."""
    room = builder.alloca(LANES, numbers)
    return Row(builder, builder.ptrtoint(room, LONG))


def counted(
    builder: ir.IRBuilder, count, body: Callable, begun: Sequence = (), down: bool = False
) -> list:
    """Write a loop: `body(k, carried)` for k = 0 to count - 1, or down from there.

    Args:
        builder: of the program.
        count: as LLVM has it.
        body: returns the values that the next pass, or who comes behind the loop, finds.
        begun: the first ones, likewise of LLVM.
        down: whether k falls.
    """
    begin, inside, behind = (builder.append_basic_block() for _ in range(3))
    before = builder.block
    builder.branch(begin)
    builder.position_at_end(begin)
    done, carried = builder.phi(LONG), [builder.phi(one.type) for one in begun]
    for phi, one in zip((done, *carried), (whole(0), *begun), strict=True):
        phi.add_incoming(one, before)
    builder.cbranch(builder.icmp_signed("<", done, count), inside, behind)
    builder.position_at_end(inside)
    k = builder.sub(builder.sub(count, whole(1)), done) if down else done
    found = body(k, carried) or ()
    following = builder.add(done, whole(1))
    for phi, one in zip((done, *carried), (following, *found), strict=True):
        phi.add_incoming(one, builder.block)
    builder.branch(begin)
    builder.position_at_end(behind)
    return carried


def counted_down(builder: ir.IRBuilder, count, body: Callable) -> None:
    """Write a loop: `body(k)` for k = count - 1 down to 0."""
    counted(builder, count, lambda k, _: body(k), down=True)


def as_long_as(builder: ir.IRBuilder, body: Callable) -> None:
    """Write a loop that ends behind the pass in which `body()` finds a bit that is not set."""
    inside, behind = (builder.append_basic_block() for _ in range(2))
    builder.branch(inside)
    builder.position_at_end(inside)
    builder.cbranch(body(), inside, behind)
    builder.position_at_end(behind)


def subprogram(module: ir.Module, name: str, arguments: int, write: Callable) -> ir.Function:
    """A function of whole numbers without a result; `write(builder, *arguments)` writes it."""
    kind = ir.FunctionType(ir.VoidType(), [LONG] * arguments)
    function = ir.Function(module, kind, name)
    builder = ir.IRBuilder(function.append_basic_block())
    write(builder, *function.args)
    builder.ret_void()
    return function
