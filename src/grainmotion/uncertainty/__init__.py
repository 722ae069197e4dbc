"""Noise, goodness of fit, covariances, and directions that the views do not determine."""
