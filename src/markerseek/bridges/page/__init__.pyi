from .launcher import Launcher
from .page_searches import PageRig, PageSearches
from .security import Access, SecurityLayer
from .server import Address, serve

__all__ = ["Access", "Address", "Launcher", "PageRig", "PageSearches", "SecurityLayer", "serve"]
