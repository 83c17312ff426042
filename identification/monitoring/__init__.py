"""Monitoring of a machine: fits of repeated surveys (cycles) compared with their history by control charts."""
