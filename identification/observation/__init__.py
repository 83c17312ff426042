"""From survey rows to equations: observation models, measuring frames, normal equations, identifiability."""
