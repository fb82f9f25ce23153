from .page_searches import PageRig, PageSearches
from .server import Address, serve
from .session_display import session_verdict

__all__ = ["Address", "PageRig", "PageSearches", "serve", "session_verdict"]
