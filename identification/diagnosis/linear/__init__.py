"""The linear model that candidates are scored in."""
