"""Report of a fit: one self-contained HTML file."""

from identification.report.write import load, report, write_report

__all__ = ["load", "report", "write_report"]
