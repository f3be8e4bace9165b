"""Work of a call that XLA's own threads share, in parts that do not know of each other.

XLA runs such calls one after the other, each on one thread. The thread that XLA calls asks for
helpers among the threads of XLA's pool, as many as the process may use cores. Who is free takes the
next part that nobody has begun, the first thread too: it never waits for a helper that has not come
yet, so that calls which need each other's threads cannot block each other. The numbers of a part
are the same whoever finds them.

The work is a block of whole numbers outside of Python's memory: it is given back by who leaves it
last, which may be a helper that came when nothing was left to do, and the call long over.
"""

from llvmlite import ir

from jcontour.native.interface import (
    CONTEXT,
    DROP_ERROR,
    INTERFACE,
    LAYOUTS,
    SCHEDULE,
    THREADS,
    own_minor,
    place,
    word,
)
from jcontour.native.numbers import INT, LONG, known
from jcontour.native.straight_line import as_long_as, counted, subprogram, whole

MINOR_SEEN = "minor"  # name of the number that a program leaves behind

# entries of a block of work [bytes]
_FRAME, _PARTS, _NEXT, _DONE, _HOLDERS, _REQUEST, _FOUND = 0, 8, 16, 24, 32, 40, 80
_BYTES = 88
_CALL = ir.FunctionType(LONG, [LONG])


def share(builder: ir.IRBuilder, frame, parts, part: ir.Function) -> None:
    """Write the sharing of a frame's work: `part(frame, k)` for all k below `parts`."""

    def one(k, _) -> None:
        builder.call(part, [frame, k])

    help_ = _helper(builder.module, part)
    work = builder.call(known(builder, "malloc", LONG, LONG), [whole(_BYTES)])
    with builder.if_else(builder.icmp_signed("==", work, whole(0))) as (without, with_memory):
        with without:
            counted(builder, parts, one)
        with with_memory:
            begun = (_FRAME, frame), (_PARTS, parts), (_NEXT, 0), (_DONE, 0), (_HOLDERS, 1)
            for entry, number in begun:
                _put(builder, work, entry, number)
            minor = own_minor(builder, frame)
            builder.store(minor, _minor(builder.module))
            first = builder.icmp_signed(">=", minor, INT(LAYOUTS.start))
            known_layout = builder.and_(first, builder.icmp_signed("<", minor, INT(LAYOUTS.stop)))
            several = builder.icmp_signed(">", parts, whole(1))
            with builder.if_then(builder.and_(known_layout, several)):
                _ask_helpers(builder, frame, work, parts, help_)
            builder.call(builder.module.globals["take"], [work])
            _wait(builder, work, parts)
            _leave(builder, work)


def _minor(module: ir.Module) -> ir.GlobalVariable:
    """Minor version of XLA's interface that the last call came with."""
    found = ir.GlobalVariable(module, INT, MINOR_SEEN)
    found.initializer = INT(LAYOUTS.start)  # pyright: ignore[reportAttributeAccessIssue]
    return found


def _helper(module: ir.Module, part: ir.Function) -> ir.Function:
    """Function of the work for XLA's threads, and `take`, which does parts until none is left."""

    def parts(builder: ir.IRBuilder, work) -> None:
        def one():
            k, parts = _added(builder, work, _NEXT, 1), word(builder, work, _PARTS)
            left = builder.icmp_signed("<", k, parts)
            with builder.if_then(left):
                builder.call(part, [word(builder, work, _FRAME), k])
                _added(builder, work, _DONE, 1)
            return left

        as_long_as(builder, one)

    take = subprogram(module, "take", 1, parts)
    help_ = ir.Function(module, _CALL, "help")
    builder, work = ir.IRBuilder(help_.append_basic_block()), help_.args[0]
    builder.call(take, [work])
    _leave(builder, work)
    builder.ret(whole(0))
    return help_


def _ask_helpers(builder: ir.IRBuilder, frame, work, parts, help_: ir.Function) -> None:
    """Put the function with the work before XLA's threads: one fewer than there are."""
    interface, context = (word(builder, frame, entry) for entry in (INTERFACE, CONTEXT))
    found = builder.add(work, whole(_FOUND))
    _request(builder, work, 32, 0, context, found)
    with builder.if_then(_granted(builder, interface, THREADS, work)):
        threads = word(builder, work, _FOUND)
        fewer = builder.select(builder.icmp_signed("<", threads, parts), threads, parts)
        address = builder.ptrtoint(help_, LONG)
        _request(builder, work, 40, 0, context, address, work)

        def ask(*_) -> None:
            _added(builder, work, _HOLDERS, 1)
            refused = builder.not_(_granted(builder, interface, SCHEDULE, work))
            with builder.if_then(refused):
                _added(builder, work, _HOLDERS, -1)

        counted(builder, builder.sub(fewer, whole(1)), ask)


def _request(builder: ir.IRBuilder, work, *numbers) -> None:
    for k, number in enumerate(numbers):
        _put(builder, work, _REQUEST + 8 * k, number)


def _granted(builder: ir.IRBuilder, interface, function: int, work):
    """Whether XLA did what is requested; its error is dropped."""
    request = builder.add(work, whole(_REQUEST))

    def call(function: int):
        address = builder.inttoptr(word(builder, interface, function), _CALL.as_pointer())
        return builder.call(address, [request])

    size, error = word(builder, request, 0), call(function)
    failed = builder.icmp_signed("!=", error, whole(0))
    with builder.if_then(failed):
        kept = word(builder, request, 16)
        _request(builder, work, 24, 0, error)
        call(DROP_ERROR)
        _request(builder, work, size, 0, kept)
    return builder.not_(failed)


def _wait(builder: ir.IRBuilder, work, parts) -> None:
    """Wait for the parts that others have begun."""
    pause = known(builder, "sched_yield", INT)

    def open_():
        left = builder.icmp_signed("<", _added(builder, work, _DONE, 0), parts)
        with builder.if_then(left):
            builder.call(pause, [])
        return left

    as_long_as(builder, open_)


def _leave(builder: ir.IRBuilder, work) -> None:
    last = builder.icmp_signed("==", _added(builder, work, _HOLDERS, -1), whole(1))
    with builder.if_then(last):
        builder.call(known(builder, "free", ir.VoidType(), LONG), [work])


def _put(builder: ir.IRBuilder, work, entry: int, number) -> None:
    number = whole(number) if isinstance(number, int) else number
    builder.store(number, place(builder, work, entry))


def _added(builder: ir.IRBuilder, work, entry: int, change: int):
    """A number before the change was added, at once for all threads."""
    return builder.atomic_rmw("add", place(builder, work, entry), whole(change), "seq_cst")
