"""Registration of the da Vinci system to the probe: points, their errors, the transform, and a session of it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
