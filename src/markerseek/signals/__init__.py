"""The imaging chain, from a frame to a reading: filter, one-way delay-and-sum, envelope, features. Pure."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
