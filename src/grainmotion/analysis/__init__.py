"""Uses of measured motions: errors against truth, deformed volumes, residual images."""
