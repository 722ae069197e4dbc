"""Benchmarks: each measures grainmotion against a named peer in the same run."""
