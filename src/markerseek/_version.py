"""The version of markerseek, kept here and nowhere else."""

__version__ = "0.4.0"
