"""Which effects a survey could show, and where: what the diagnosis searches."""
