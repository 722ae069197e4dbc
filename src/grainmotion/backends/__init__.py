"""Backends: the CPU, an NVIDIA GPU or the workers of a cluster project grains and apply their Jacobian."""
