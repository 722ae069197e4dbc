"""States in order: what the last two tell of the next, and cumulative and incremental motions in one table."""
