"""Numbers of eight problems side by side, in memory that a program takes for them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from llvmlite import ir

from jcontour.native.numbers import INT, LANES, LONG, WIDTH, Number, Whole, known, value
from jcontour.native.straight_line import Row, whole

_ENTRY = 8 * WIDTH  # bytes


@dataclass(frozen=True)
class Column:
    """Entries of eight numbers, one of each problem."""

    builder: ir.IRBuilder
    first: Any  # pointer to the first one

    @classmethod
    def at(cls, builder: ir.IRBuilder, memory, entry: int) -> "Column":
        """Column that begins at an entry of a memory."""
        first = builder.inttoptr(memory, LANES.as_pointer())
        return cls(builder, builder.gep(first, [whole(entry)], inbounds=True))

    def __getitem__(self, entry: int | Whole) -> Number:
        return Number(self.builder, self.builder.load(self._place(entry), align=_ENTRY))

    def __setitem__(self, entry: int | Whole, number) -> None:
        self.builder.store(value(number), self._place(entry), align=_ENTRY)

    def _place(self, entry: int | Whole):
        if isinstance(entry, int):
            return self.builder.gep(self.first, [whole(entry)], inbounds=True)
        counted = self.builder.gep(self.first, [entry.value], inbounds=True)
        return self.builder.gep(counted, [whole(entry.added)], inbounds=True)


class Eight(NamedTuple):
    """Members of a batch in the lanes of a program; those behind the last one are the last one."""

    builder: ir.IRBuilder
    members: list

    @classmethod
    def of(cls, builder: ir.IRBuilder, group, count) -> "Eight":
        """Group of eight of so many members."""
        first, last = builder.mul(group, whole(WIDTH)), builder.sub(count, whole(1))
        members = [builder.add(first, whole(lane)) for lane in range(WIDTH)]
        return cls(
            builder,
            [
                builder.select(builder.icmp_signed("<", member, last), member, last)
                for member in members
            ],
        )

    def gathered(self, row: Row, size: int, place) -> Number:
        """Number at a place among the `size` numbers of each member."""
        found: Any = ir.Constant(LANES, ir.Undefined)
        for lane, member in enumerate(self.members):
            number = row.one(self._place(member, size, place))
            found = self.builder.insert_element(found, number, INT(lane))
        return Number(self.builder, found)

    def scatter(self, row: Row, size: int, place, number: Number) -> None:
        """The other way."""
        for lane, member in enumerate(self.members):
            one = self.builder.extract_element(value(number), INT(lane))
            row.write_one(self._place(member, size, place), one)

    def _place(self, member, size: int, place):
        return self.builder.add(self.builder.mul(member, whole(size)), place)


def with_memory(builder: ir.IRBuilder, entries: int, write: Callable, without: Callable) -> None:
    """Write what uses memory for so many entries, `write(memory)`, and what is done without any."""
    taken = builder.call(known(builder, "malloc", LONG, LONG), [whole(_ENTRY * (entries + 1))])
    whole_lines = builder.and_(builder.add(taken, whole(_ENTRY - 1)), whole(-_ENTRY))
    with builder.if_else(builder.icmp_signed("!=", taken, whole(0))) as (there, missing):
        with there:
            write(whole_lines)
            builder.call(known(builder, "free", ir.VoidType(), LONG), [taken])
        with missing:
            without()
