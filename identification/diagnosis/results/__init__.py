"""What the search found, as findings, statements and a verdict."""
