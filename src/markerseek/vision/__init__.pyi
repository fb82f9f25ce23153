from .as_published import published_sensitive_range
from .camera_image import SUFFIXES, brightness, decoded_image, says_its_end
from .opencv import opencv
from .rectangle import Rectangle
from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .spot import LaserSpot, NoSpot, SpotAnswer, TwoSpots, find_spot, lit_pairs
from .tooltip import Tip, brightest_blob, find_tip

__all__ = [
    "SUFFIXES",
    "LaserSpot",
    "NoSpot",
    "Rectangle",
    "SensitiveRange",
    "SpotAnswer",
    "Tip",
    "TipFrame",
    "TwoSpots",
    "brightest_blob",
    "brightness",
    "decoded_image",
    "find_spot",
    "find_tip",
    "lit_pairs",
    "opencv",
    "published_sensitive_range",
    "says_its_end",
    "sensitive_range",
]
