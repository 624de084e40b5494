"""Parameters from measurements: thermal models from heating logs, paths from lengths."""
