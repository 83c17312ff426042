"""How work is run: parallel jobs, progress, convex solvers."""
