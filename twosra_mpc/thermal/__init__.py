"""Melting and freezing of one segment: models, uncertainty, sensor, controller. Plain numbers."""
