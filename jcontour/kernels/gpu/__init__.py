"""Kernels of a GPU: a lane for every member of a batch, see `kernels.gpu.lanes`."""
