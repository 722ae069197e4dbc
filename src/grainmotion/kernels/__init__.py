"""Numba kernels: arrays in, arrays out; they know no nouns, check nothing and allocate as little as possible."""
