from .as_published import published_sensitive_range
from .clock_offset import ClockOffset, clock_offset
from .images import SUFFIXES, Rectangle, brightness, decoded_image, opencv, says_its_end
from .matched_point import MatchedPoint, match_point
from .scene_motion import SceneFollower, SceneSeen, scene_motion
from .scene_move import MOVED_DEG, MOVED_MM, SceneMove
from .scene_watch import SceneWatch
from .sensitive_range import SensitiveRange, TipFrame, sensitive_range
from .spot import LIT_SHARE, LaserSpot, NoSpot, QuickSpot, SpotAnswer, TwoSpots, find_spot, lit_pairs, quick_spot
from .texture import NotKnown, SceneTexture, scene_texture
from .tissue_motion import DisplacementSeries, TissueMoves, tissue_motion
from .told_apart import RETURN_S, EndoscopeMoved, Moment, Sighting, SpotSlid, ToldApart, told_apart

__all__ = [
    "LIT_SHARE",
    "MOVED_DEG",
    "MOVED_MM",
    "RETURN_S",
    "SUFFIXES",
    "ClockOffset",
    "DisplacementSeries",
    "EndoscopeMoved",
    "LaserSpot",
    "MatchedPoint",
    "Moment",
    "NoSpot",
    "NotKnown",
    "QuickSpot",
    "Rectangle",
    "SceneFollower",
    "SceneMove",
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
    "match_point",
    "opencv",
    "published_sensitive_range",
    "quick_spot",
    "says_its_end",
    "scene_motion",
    "scene_texture",
    "sensitive_range",
    "tissue_motion",
    "told_apart",
]
