"""Rigid transforms between named frames, point registration with its errors, and stereo cameras. Pure."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
