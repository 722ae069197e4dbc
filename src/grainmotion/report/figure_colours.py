"""Colours of lines in the figures of plans and inspections."""

LINE_COLOURS = ("#2f7ed8", "#d9722e")
