from .as_published import published_sensitive_range
from .images import SUFFIXES, Rectangle, brightness, decoded_image, opencv, says_its_end
from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .spot import LaserSpot, NoSpot, SpotAnswer, TwoSpots, find_spot, lit_pairs

__all__ = [
    "SUFFIXES",
    "LaserSpot",
    "NoSpot",
    "Rectangle",
    "SensitiveRange",
    "SpotAnswer",
    "TipFrame",
    "TwoSpots",
    "brightness",
    "decoded_image",
    "find_spot",
    "lit_pairs",
    "opencv",
    "published_sensitive_range",
    "says_its_end",
    "sensitive_range",
]
