"""Candidate effects of a survey: their locations, driving channels and shapes."""
