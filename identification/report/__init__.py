"""The report of a fit: one HTML file that holds everything it shows."""

from identification.report.write import report, write_report

__all__ = ["report", "write_report"]
