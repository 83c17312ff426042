"""Inference on top of ``errormodel``: groups, fits, reports and the command line."""
