"""Objects in images: the laser spot seen by a camera, the tip of an instrument in B-mode. Pure; needs OpenCV."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
