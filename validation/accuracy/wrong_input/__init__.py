"""Wrong input: how often each mistake is named, and how often right input raises an alarm.

`study` measures what has no verdict of the package as it is now (``.accuracy/wrong_input``, a file a trial) and makes
the section.
``python -m validation.accuracy.wrong_input [NAME ...]`` measures the named inputs anew and rewrites the section.
"""

from __future__ import annotations

from validation.accuracy.wrong_input.tables import study

__all__ = ["study"]
