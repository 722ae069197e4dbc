"""The residual of a state and its normal equations."""
