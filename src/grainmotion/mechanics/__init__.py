"""Mechanics of a state: strain, contacts, fabric and void ratio from the motions of the grains."""
