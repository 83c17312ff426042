"""Interpretation and correction of machine programmes (G-code): parsing, execution, rewriting, verification.

`words` splits lines into words and accounts for every character, `codes` lists the words of each dialect, `reading`
holds what the programme does not state (offsets, positions of the axes), `interpreter` executes, `divide` splits paths
where the correction bends, `rewrite` writes, `check` executes the written programme and compares it with the original.
"""
