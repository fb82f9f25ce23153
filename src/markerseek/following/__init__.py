"""Following: the probe turns to what the surgeon looks at, by a registration that is carried along and confirmed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
