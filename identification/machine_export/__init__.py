"""Descriptions of machines in the formats of others, from a machine file or from a fit."""
