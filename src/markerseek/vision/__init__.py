"""Camera images to numbers: the laser spot in the endoscope's images. Pure; OpenCV is loaded when it is needed."""

from markerseek.vision.spot import NoSpot, Spot, SpotAnswer, TwoSpots, find_spot

__all__ = ["NoSpot", "Spot", "SpotAnswer", "TwoSpots", "find_spot"]
