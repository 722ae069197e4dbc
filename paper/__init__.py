"""Every result of the D-DPC paper (Khalili et al. 2017), rerun: ``python -m paper`` writes ``docs/paper.md``."""
