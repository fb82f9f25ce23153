"""The version of markerseek, kept here and nowhere else."""

__version__ = "0.5.0"
