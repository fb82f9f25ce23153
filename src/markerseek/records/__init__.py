"""Recorded data: the result of a search, the devices that replay a bank, and series of B-mode images.

Banks, journals and exports are the packages below this one.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
