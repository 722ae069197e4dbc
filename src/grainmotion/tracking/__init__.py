"""Tracking of one state: initial guess, free stages, global search, refinement and classification."""
