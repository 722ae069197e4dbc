"""Volumes and moving grains to radiographs, with adjoint and derivatives."""
