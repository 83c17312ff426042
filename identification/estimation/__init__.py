"""Estimators: one file each, one signature."""
