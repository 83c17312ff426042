"""The normal range of every parameter of a machine, learned from its own repeated cycles, and the alarm beyond it."""
