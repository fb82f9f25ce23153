from .desk import Desk, Launcher, Rig
from .security import Access, SecurityLayer
from .server import Address, serve
from .settings import PageSettings

__all__ = ["Access", "Address", "Desk", "Launcher", "PageSettings", "Rig", "SecurityLayer", "serve"]
