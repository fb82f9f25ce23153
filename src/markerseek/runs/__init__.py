"""What happens on a rig over time: searches kept in a journal and resumed, scans of banks, registration.

`markerseek.rigs` only assembles rigs. The commands and the studies start here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
