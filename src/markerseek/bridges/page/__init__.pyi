from .page_searches import PageRig, PageSearches
from .server import Address, serve

__all__ = ["Address", "PageRig", "PageSearches", "serve"]
