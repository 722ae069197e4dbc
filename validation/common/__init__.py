"""What `paper` and `accuracy` share: pages made of sections, trials on all cores, results that are kept."""
