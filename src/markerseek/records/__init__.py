"""Results of searches, devices that replay a bank, series of B-mode images.

The packages below hold banks, journals, streams of events, and exports.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
