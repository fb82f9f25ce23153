"""markerseek finds a photoacoustic marker with a motorised transrectal ultrasound probe, by itself."""

from markerseek._version import __version__

__all__ = ["__version__"]
