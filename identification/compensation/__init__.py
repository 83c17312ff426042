"""Correction tables for a machine controller, computed from a fitted error model, and their residual errors."""
