"""Numba kernels: arrays in, arrays out; they know no records, check nothing and allocate as little as possible."""

import os

# Threads that wait for others sleep.  OpenMP's default is to spin, which on a shared machine takes the cores
# from the threads that work: tracking a small state was 6 times slower, in wall and in CPU time.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
