"""Reconstruction of volumes from full scans."""
