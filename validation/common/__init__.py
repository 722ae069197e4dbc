"""Shared by all studies: pages made of sections, trials on all cores, results cached on disk."""
