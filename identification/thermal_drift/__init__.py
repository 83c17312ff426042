"""Thermal drift of error motions: regression on lagged temperatures from recordings over thermal cycles."""
