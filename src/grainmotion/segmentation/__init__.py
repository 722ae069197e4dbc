"""A reconstructed volume to labelled grains."""
