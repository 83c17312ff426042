"""Poses by optimal design, and what they could detect, tell apart or never see, before anything is measured."""
