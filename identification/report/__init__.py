"""The report of a fit: one HTML file that holds everything it shows."""

from identification.report.write import write_report

__all__ = ["write_report"]
