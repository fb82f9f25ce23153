from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .tip_reader import TipReader, TipSettings
from .tooltip import Rectangle, Tip, brightest_blob, find_tip

__all__ = [
    "Rectangle",
    "SensitiveRange",
    "Tip",
    "TipFrame",
    "TipReader",
    "TipSettings",
    "brightest_blob",
    "find_tip",
    "sensitive_range",
]
