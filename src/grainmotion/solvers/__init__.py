"""Solvers of nonlinear least squares and linear systems; they know no X-rays."""
