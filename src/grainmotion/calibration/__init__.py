"""What self-calibration is made of: the corrections, and a binned scan on which they are tried."""
