"""Kernels on an NVIDIA card: the walks of `kernels.ray_tracing` and `kernels.grain_projection`, one thread a ray.

Imported only where `device` has found numba-cuda.  Functions have the names, arguments and meaning of those of
the CPU; what is large comes and goes as `DeviceArray`, an array that stays on the card.
"""
