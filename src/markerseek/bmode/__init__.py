"""Series of B-mode images of files: PNG, DICOM, Ultrasonix ``.b8`` and sequences; `markerseek.vision` finds the tip."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
