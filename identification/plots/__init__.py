"""Figures of machines, models and residuals: one file per figure, on matplotlib's object interface."""
