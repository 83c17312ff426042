"""Mistakes in a recording, looked for before any physics: columns, rows, clocks, sensors, outliers."""
