"""Why some inputs are not named, or not always, and which warnings on right experiments are right."""

from __future__ import annotations

REMARKS: dict[str, str] = {}
