"""Thermal error motions of a joint from point clouds of artefacts, scanned cold and warm by a sensor on it."""
