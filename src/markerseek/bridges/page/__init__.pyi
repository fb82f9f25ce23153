from .launcher import Launcher
from .page_searches import PageRig, PageSearches
from .security import Access, SecurityLayer
from .server import Address, serve
from .settings import PageSettings

__all__ = ["Access", "Address", "Launcher", "PageRig", "PageSearches", "PageSettings", "SecurityLayer", "serve"]
