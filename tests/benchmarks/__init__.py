"""Ratios to what a competent user would take, all measured in one run: ``python -m tests.benchmarks.speed``."""
