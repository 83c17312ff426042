"""How work is run: processes, progress, convex solvers."""
