"""Models of cost, to compare with measurements."""
