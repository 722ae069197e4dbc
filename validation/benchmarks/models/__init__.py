"""Models of cost, beside what is measured."""
