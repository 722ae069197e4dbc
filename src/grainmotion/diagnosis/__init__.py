"""Checks that name wrong but plausible input: each is a function from what was read to findings."""
