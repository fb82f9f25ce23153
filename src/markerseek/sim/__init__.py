"""Simulated rigs: virtual time, tissue, stage, laser and receiver. All that they produce is marked as simulated.

It uses `acoustics` and never `signals`: the forward model and the imaging share no code.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
