"""What people are shown of a search: its answer in words, its curve, figures, HTML pages, and grey levels of images.

Values come in, text and drawings go out. Matplotlib and Jinja2 are imported when they are needed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
