"""The report of a fit: one HTML file that holds everything it shows."""

from identification.report.write import load, report, write_report

__all__ = ["load", "report", "write_report"]
