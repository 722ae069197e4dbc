"""How accurate grainmotion is, on simulated samples: ``python -m validation.accuracy`` writes ``docs/accuracy.md``."""
