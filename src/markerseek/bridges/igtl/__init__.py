"""OpenIGTLink: a search for 3D Slicer, PLUS and robot controllers.

`IgtlServer` sends messages to all clients and takes their commands; `SearchService` runs the searches that they ask
for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
