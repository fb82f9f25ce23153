from .page_searches import PageRig, PageSearches
from .server import Address, serve
from .settings import PageSettings

__all__ = ["Address", "PageRig", "PageSearches", "PageSettings", "serve"]
