"""Bridges: other programs watch a search, or ask for one, over a network or in a browser.

Each bridge starts the ordinary command as a child process and follows its record; it holds no device. So a
search that is asked for from outside gives the same answer as one from a terminal, and passes the same guard.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
