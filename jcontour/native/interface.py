"""XLA's C interface for foreign functions (`xla/ffi/api/c_api.h`, version 0): places in it [bytes].

The functions write how a program reads them.
"""

from llvmlite import ir

from jcontour.native.numbers import INT, LONG

# of a call frame
EXTENSION = 8
INTERFACE, CONTEXT = 16, 24
ARGUMENTS = 72
RESULTS = 112
# of a buffer
DATA, RANK, EXTENTS = 24, 32, 40
# of an extension, and of the metadata that it asks for
KIND, METADATA = 8, 24
MAJOR, MINOR, TRAITS = 24, 28, 32
IS_METADATA = 1
# of the interface
OWN_MINOR = 36
DROP_ERROR, SCHEDULE, THREADS = 64, 136, 144
LAYOUTS = range(3, 5)  # minor versions that the places of the last row are of


def place(builder: ir.IRBuilder, address, offset: int, kind=LONG):
    """Pointer to what lies behind an address."""
    return builder.inttoptr(builder.add(address, LONG(offset)), kind.as_pointer())


def word(builder: ir.IRBuilder, address, offset: int):
    """Whole number of eight bytes behind an address."""
    return builder.load(place(builder, address, offset))


def own_minor(builder: ir.IRBuilder, frame):
    """Minor version of the interface that a frame comes from."""
    return builder.load(place(builder, word(builder, frame, INTERFACE), OWN_MINOR, INT))
