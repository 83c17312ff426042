"""Optimal design of measuring poses, and power analysis of the effects that they could detect and distinguish."""
