"""Records of the data: geometry, volume, scan, grains, motions."""
