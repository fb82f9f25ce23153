from .as_published import published_sensitive_range
from .lit import lit_pairs
from .rectangle import Rectangle
from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .spot import LaserSpot, NoSpot, SpotAnswer, TwoSpots, find_spot
from .tip_reader import TipReader, TipSettings
from .tooltip import Tip, brightest_blob, find_tip

__all__ = [
    "LaserSpot",
    "NoSpot",
    "Rectangle",
    "SensitiveRange",
    "SpotAnswer",
    "Tip",
    "TipFrame",
    "TipReader",
    "TipSettings",
    "TwoSpots",
    "brightest_blob",
    "find_spot",
    "find_tip",
    "lit_pairs",
    "published_sensitive_range",
    "sensitive_range",
]
