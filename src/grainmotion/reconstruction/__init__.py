"""What reconstruction is made of."""
