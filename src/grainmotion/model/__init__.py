"""Records that the rest works on: geometry, volume, scan, grains, motions."""
