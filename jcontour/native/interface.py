"""Places in XLA's C interface for foreign functions (`xla/ffi/api/c_api.h`, version 0) [bytes]."""

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
LAYOUT = 3  # minor version that the places of the last row are of
