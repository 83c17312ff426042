"""Results as they are stored, tabulated and handed to users."""
