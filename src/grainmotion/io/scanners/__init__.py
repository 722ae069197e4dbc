"""The files in which scanners and beamlines describe a scan, one reader a format."""
