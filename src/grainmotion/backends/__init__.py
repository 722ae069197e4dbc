"""Where arrays lie and who computes on them: processor, GPU, Dask workers."""
