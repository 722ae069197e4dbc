"""Settings of all tests: hypothesis draws the same examples in every run and sets no time limit on them."""

from hypothesis import settings

settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")
