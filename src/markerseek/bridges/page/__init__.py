"""The live page: a process of its own that shows and starts searches, in a browser, by NiceGUI.

It holds no device: it starts the ordinary commands as children and reads their streams of events.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
