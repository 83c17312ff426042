"""Drawings of machines, models and residuals: one file a drawing, all on matplotlib's object interface."""
