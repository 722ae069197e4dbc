"""The order of a run, what it keeps and what it writes."""
