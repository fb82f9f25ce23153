"""Many runs, one table: a study is policies × worlds × trials, run on the cores of this machine, and summarised."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
