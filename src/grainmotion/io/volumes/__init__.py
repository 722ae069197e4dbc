"""Volumes and labels in the formats of other programs: one format a module, read as a `record.VolumeFile`."""
