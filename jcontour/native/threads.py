"""Work of a native call that XLA's own threads share, in parts that do not know of each other.

XLA runs such calls one after the other, each on one thread. The thread that XLA calls asks for
helpers among the threads of XLA's pool, as many as the process may use cores. Who is free takes the
next part that nobody has begun, the first thread too: it never waits for a helper that has not come
yet, so that calls which need each other's threads cannot block each other. The numbers of a part
are the same whoever finds them.

The work is a block of whole numbers outside of Python's memory: it is given back by who leaves it
last, which may be a helper that came when nothing was left to do, and the call long over.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from jcontour.native.interface import (
    CONTEXT,
    DROP_ERROR,
    INTERFACE,
    LAYOUT,
    OWN_MINOR,
    SCHEDULE,
    THREADS,
)
from jcontour.native.lanes import part
from jcontour.native.memory import ints, longs, word

# entries of a block of work, after a zero: a call frame begins with its own size
_FRAME, _PARTS, _NEXT, _DONE, _HOLDERS, _REQUEST, _FOUND = 1, 2, 3, 4, 5, 6, 11
_WORDS = 12

_acquire = types.ExternalFunction("malloc", types.intp(types.intp))
_release = types.ExternalFunction("free", types.void(types.intp))
_pause = types.ExternalFunction("sched_yield", types.int32())


@intrinsic
def own_address(context) -> Any:
    """Address that XLA knows the function by; only in the function that `native_call` decorates."""

    def code(context, builder, signature, values):
        name = f"cfunc.{builder.function.name}"  # what Numba calls it
        known = builder.module.globals.get(name)
        long = ir.IntType(64)
        known = known or ir.Function(builder.module, ir.FunctionType(long, [long]), name)
        return builder.ptrtoint(known, long)

    return types.intp(), code


@intrinsic
def _called(context, function, argument) -> Any:
    """Result of the C function at an address."""

    def code(context, builder, signature, values):
        long = ir.IntType(64)
        kind = ir.FunctionType(long, [long]).as_pointer()
        return builder.call(builder.inttoptr(values[0], kind), [values[1]])

    return types.intp(types.intp, types.intp), code


@intrinsic
def _added(context, place, change) -> Any:
    """Whole number at an address before the change was added, at once for all threads."""

    def code(context, builder, signature, values):
        pointer = builder.inttoptr(values[0], ir.IntType(64).as_pointer())
        return builder.atomic_rmw("add", pointer, values[1], "seq_cst")

    return types.intp(types.intp, types.intp), code


@part
def is_work(address):
    """Whether a native function is called by a helper: with shared work, not with a frame."""
    return word(address) == 0


@part
def shared_work(frame, parts, function):
    """Address of the work of a frame, begun; helpers are on their way. Zero without memory.

    Args:
        frame: as XLA handed it over.
        parts: of the work.
        function: its `own_address`, that helpers call with the work.
    """
    work = _acquire(8 * _WORDS)
    if work == 0:
        return work
    block = carray(longs(work), _WORDS)
    block[:] = 0
    block[_FRAME], block[_PARTS], block[_HOLDERS] = frame, parts, 1
    interface = word(frame + INTERFACE)
    if parts > 1 and function != 0 and carray(ints(interface + OWN_MINOR), 1)[0] == LAYOUT:
        _ask_helpers(interface, word(frame + CONTEXT), work, block, function)
    return work


@part
def _ask_helpers(interface, context, work, block, function):
    """Put the function with the work before XLA's threads: one fewer than there are."""
    request = work + 8 * _REQUEST
    block[_REQUEST], block[_REQUEST + 2] = 32, context
    block[_REQUEST + 3] = work + 8 * _FOUND
    if not _granted(interface, THREADS, request):
        return
    block[_REQUEST], block[_REQUEST + 3], block[_REQUEST + 4] = 40, function, work
    for _ in range(min(block[_FOUND], block[_PARTS]) - 1):
        _added(work + 8 * _HOLDERS, 1)
        if not _granted(interface, SCHEDULE, request):
            _added(work + 8 * _HOLDERS, -1)
            return


@part
def _granted(interface, place, request):
    """Whether XLA did what is requested; its error is dropped."""
    error = _called(word(interface + place), request)
    if error == 0:
        return True
    carray(longs(request), 5)[0] = 24
    carray(longs(request), 5)[2] = error
    _called(word(interface + DROP_ERROR), request)
    return False


@part
def frame_of(work):
    """Frame of the work; it is there as long as a part is not done."""
    return word(work + 8 * _FRAME)


@part
def next_part(work):
    """A part that nobody has begun; below zero when there is none."""
    begun = _added(work + 8 * _NEXT, 1)
    return begun if begun < word(work + 8 * _PARTS) else -1


@part
def done(work):
    """Say that a part is done, or that it cannot be."""
    _added(work + 8 * _DONE, 1)


@part
def leave(work, waits):
    """Leave the work, first waiting for the parts that others have begun if asked to."""
    while waits and _added(work + 8 * _DONE, 0) < word(work + 8 * _PARTS):
        _pause()
    if _added(work + 8 * _HOLDERS, -1) == 1:
        _release(work)
