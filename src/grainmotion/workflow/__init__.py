"""A run: its stages in order, their fingerprints, and the files that they write."""
