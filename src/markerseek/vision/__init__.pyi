from .as_published import published_sensitive_range
from .clock_offset import ClockOffset, clock_offset
from .images import SUFFIXES, Rectangle, brightness, decoded_image, opencv, says_its_end
from .scene_motion import SceneFollower, SceneSeen, scene_motion
from .scene_watch import SceneWatch
from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .spot import LaserSpot, NoSpot, SpotAnswer, TwoSpots, find_spot, lit_pairs
from .texture import NotKnown, SceneTexture, scene_texture
from .tissue_motion import DisplacementSeries, TissueMoves, tissue_motion
from .told_apart import EndoscopeMoved, Moment, Sighting, SpotSlid, ToldApart, told_apart

__all__ = [
    "SUFFIXES",
    "ClockOffset",
    "DisplacementSeries",
    "EndoscopeMoved",
    "LaserSpot",
    "Moment",
    "NoSpot",
    "NotKnown",
    "Rectangle",
    "SceneFollower",
    "SceneSeen",
    "SceneTexture",
    "SceneWatch",
    "SensitiveRange",
    "Sighting",
    "SpotAnswer",
    "SpotSlid",
    "TipFrame",
    "TissueMoves",
    "ToldApart",
    "TwoSpots",
    "brightness",
    "clock_offset",
    "decoded_image",
    "find_spot",
    "lit_pairs",
    "opencv",
    "published_sensitive_range",
    "says_its_end",
    "scene_motion",
    "scene_texture",
    "sensitive_range",
    "tissue_motion",
    "told_apart",
]
