"""Fleets: many surveys of many machines in one run, and what only all of them together can tell."""
