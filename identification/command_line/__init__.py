"""The command line. It calls the public functions and prints what they return."""
