"""Measurements: the paper rerun, the accuracy, the benchmarks."""
