"""The experiment file: read, validated, its inputs found and checked before any work begins."""
