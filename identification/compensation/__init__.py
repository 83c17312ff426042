"""From a fit to tables that a controller takes, with what they leave over."""
