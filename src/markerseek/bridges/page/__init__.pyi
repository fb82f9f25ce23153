from .desk import Desk, PageRig
from .launcher import Launcher
from .security import Access, SecurityLayer
from .server import Address, serve
from .settings import PageSettings

__all__ = ["Access", "Address", "Desk", "Launcher", "PageRig", "PageSettings", "SecurityLayer", "serve"]
