"""Self-calibration of the scanner on its reference scan: geometry of panel and axis, and beam hardening."""
