"""Measure some inputs anew and rewrite the section: ``python -m validation.accuracy.wrong_input [NAME ...]``."""

from __future__ import annotations

import argparse

from validation.accuracy.page import PAGE
from validation.accuracy.wrong_input import measure, tables

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m validation.accuracy.wrong_input", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="inputs to measure anew; none: the section alone")
    parser.add_argument("--missing", action="store_true", help="measure all that was never measured")
    parser.add_argument("--seeds", type=int, default=measure.SEEDS, help="seeds of each, most")
    options = parser.parse_args()
    if options.names:
        measure.measure(measure.jobs(options.names, options.seeds))
    if options.missing:
        measure.measure(measure.missing(measure.jobs((), options.seeds)))
    PAGE.write("wrong_input", tables.section())
