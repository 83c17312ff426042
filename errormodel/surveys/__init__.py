"""What `errormodel.survey` reads a survey with: its files, columns, checks, and rows of raw files and observations."""
