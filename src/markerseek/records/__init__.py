"""Files: banks, journals and arrays of other programs. The packages below hold banks and journals.

What a person reads of them is phrased and drawn in `markerseek.show`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
