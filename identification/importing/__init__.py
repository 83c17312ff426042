"""Raw files of instruments and controllers into a survey: columns, dwells, matching, and the proof of the join."""
