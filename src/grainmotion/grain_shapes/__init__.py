"""Shapes of single grains for other codes: surface meshes, level sets, clumps of spheres, spherical harmonics."""
