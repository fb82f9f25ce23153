"""Objects in ultrasound images: the tip of an instrument, and how far off the plane it is seen. Pure; needs OpenCV."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
