"""Descriptions of machines in the formats of others, in and out: a plug-in registry, one file per format."""
