"""Observation models, measuring frames, normal equations and identifiability of the rows of a survey."""
