"""One self-contained HTML page that shows what was measured, and how well."""

from grainmotion.report.data import ReportData, StateReport
from grainmotion.report.page import write_report

__all__ = ["ReportData", "StateReport", "write_report"]
