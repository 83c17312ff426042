"""The decisions of a diagnosis: the rules by name, and the log of what they decided."""
