"""Results of commands and of the Python API: tables, files, and folders with manifests."""
