"""The search for missing physics: candidates, scores, forward selection, model comparison, noise models."""
