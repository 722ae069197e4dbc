"""Planning of an experiment: candidate views, their information, the choice among them, the capture range."""
