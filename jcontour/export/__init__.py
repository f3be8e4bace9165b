"""Linear controllers as code for a drive: C99, IEC 61131-3 structured text, plain NumPy."""
