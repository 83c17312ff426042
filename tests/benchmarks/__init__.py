"""Ratios to what a competent user would otherwise use, all measured in one run: ``python -m tests.benchmarks.speed``."""
