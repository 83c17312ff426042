"""Programmes of machines: read strictly, executed, corrected, and checked before they are written.

`words` splits lines into words and accounts for every character, `codes` says which words of a dialect are understood,
`reading` holds what the programme does not say (offsets, where axes stand), `interpreter` executes, `divide` cuts
paths where the correction bends, `rewrite` writes, `check` executes what was written against what was read.
"""
