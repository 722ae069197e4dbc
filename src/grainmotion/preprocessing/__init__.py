"""Detector counts to line integrals."""
