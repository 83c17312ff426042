"""Conformity with tolerances: decision rules, and what they say of the quantities of a standard."""
