"""The experiment file: read and validated, its input files located and checked before any work begins."""
