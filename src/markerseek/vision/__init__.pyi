from .rectangle import Rectangle
from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .spot import NoSpot, Spot, SpotAnswer, TwoSpots, find_spot
from .tip_reader import TipReader, TipSettings
from .tooltip import Tip, brightest_blob, find_tip

__all__ = [
    "NoSpot",
    "Rectangle",
    "SensitiveRange",
    "Spot",
    "SpotAnswer",
    "Tip",
    "TipFrame",
    "TipReader",
    "TipSettings",
    "TwoSpots",
    "brightest_blob",
    "find_spot",
    "find_tip",
    "sensitive_range",
]
