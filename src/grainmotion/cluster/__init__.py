"""The same verbs over Dask: who works, and nothing else, is different.

`connection.connect` reaches a scheduler or starts processes here; `dask_backend.Team` walks blocks of grains for
`track`. Dask is imported only here, and only when asked for.
"""
