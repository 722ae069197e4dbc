"""What `track` is made of: the residual of a state, its stages and starts, lost grains, and the verdict."""
