"""Kernels on an NVIDIA GPU: the ray tracing of `kernels.ray_tracing` and `kernels.grain_projection`, one thread a ray.

Imported only where numba-cuda is installed.  Functions have the names and the meaning of those of the CPU; large
arrays come and go as `DeviceArray`, which stays in GPU memory.
"""
