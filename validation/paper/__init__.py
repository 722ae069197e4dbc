"""Every result of the D-DPC paper (Khalili et al. 2017), rerun: `make paper` writes ``docs/paper.md``."""
