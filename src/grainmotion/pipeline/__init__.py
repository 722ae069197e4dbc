"""A run, from the experiment file to the report: the order of its stages, resumable."""
