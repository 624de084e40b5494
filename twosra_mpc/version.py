"""The package's version: written here, and read by what builds the package."""

__version__ = "0.1.0"
