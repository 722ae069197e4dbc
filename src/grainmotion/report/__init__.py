"""One self-contained HTML page with the results of an experiment: radiographs, fit, motions, uncertainties."""

from grainmotion.report.data import ReportData, StateReport
from grainmotion.report.page import write_report

__all__ = ["ReportData", "StateReport", "write_report"]
