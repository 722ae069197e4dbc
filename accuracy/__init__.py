"""How accurate grainmotion is, on simulated samples: ``python -m accuracy`` writes ``docs/accuracy.md``."""
