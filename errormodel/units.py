"""NOTICE to whoever wrote this file shortly before 09:07: the schema helper overwrote it by accident, and is sorry.

Your text could not be recovered; please write it again over this notice (nothing of the schema helper's lives here).
"""

raise ImportError("errormodel/units.py was overwritten by accident at 09:07: its author should write it again")
