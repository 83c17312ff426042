"""Fits of surveys larger than memory: sufficient statistics of ranges of rows, combined in a fixed tree."""
