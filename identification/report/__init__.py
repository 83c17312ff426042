"""Report of a fit: one self-contained HTML file."""

from identification.report.write import report, write_report

__all__ = ["report", "write_report"]
