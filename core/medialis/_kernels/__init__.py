"""Numba kernels that several stages share. Only kernel modules import numba."""
