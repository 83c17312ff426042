"""The project's own proof: machines with concealed physics, sealed truths, and what the tool makes of them.

The simulator (all modules but `run`, `score` and `__main__`) is plain NumPy and SciPy and imports nothing from the
toolkit. ``python -m tests.proof --help`` says how to run it.
"""
