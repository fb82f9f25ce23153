"""Values, protocols, events and errors that all other packages share. Pure; it imports none of them."""

from markerseek.core.array import LinearArray
from markerseek.core.arrival import Arrival, LocalMaxima
from markerseek.core.checks import require_range
from markerseek.core.errors import (
    AcquisitionError,
    ConfigError,
    DeviceError,
    DeviceTimeoutError,
    LaserError,
    LimitError,
    MarkerseekError,
    MissingExtraError,
    MoveError,
    NotConnectedError,
    ReadingError,
    RecordError,
    SaturationError,
    SearchError,
    needs_package,
)
from markerseek.core.estimate import (
    Ambiguous,
    AtBound,
    Estimate,
    Floor,
    Found,
    IntervalKind,
    NotFound,
    OtherSource,
    Unsure,
)
from markerseek.core.events import Asked, Event, Failed, Finished, Measured, Refused, Role, Started
from markerseek.core.facts import RigFacts, RigKind
from markerseek.core.frame import BModeFrame, ChannelFrame, Frame, FrameHeader, ReadingFrame, RFFrame
from markerseek.core.image import BModeImage, PaImage, ScanGeometry
from markerseek.core.interval import PAPER_RANGE, Interval, as_interval
from markerseek.core.marker import MarkerPosition, marker_position
from markerseek.core.marker_curve import MarkerCurve
from markerseek.core.number import is_finite, is_whole
from markerseek.core.permit import Permit
from markerseek.core.plan import SearchPlan
from markerseek.core.protocols import Clock, ConfirmablePolicy, Laser, Policy, Reader, Receiver, Stage
from markerseek.core.reading import (
    LEAST_INTENSITY,
    MOST_ACQUISITIONS,
    MOST_ARRIVALS,
    MOST_INTENSITY,
    Reading,
    Sample,
)
from markerseek.core.shapes import Bool, Complex128, Float32, Float64, Int16, Int32, Int64, UInt8

__all__ = [
    "LEAST_INTENSITY",
    "MOST_ACQUISITIONS",
    "MOST_ARRIVALS",
    "MOST_INTENSITY",
    "PAPER_RANGE",
    "AcquisitionError",
    "Ambiguous",
    "Arrival",
    "Asked",
    "AtBound",
    "BModeFrame",
    "BModeImage",
    "Bool",
    "ChannelFrame",
    "Clock",
    "Complex128",
    "ConfigError",
    "ConfirmablePolicy",
    "DeviceError",
    "DeviceTimeoutError",
    "Estimate",
    "Event",
    "Failed",
    "Finished",
    "Float32",
    "Float64",
    "Floor",
    "Found",
    "Frame",
    "FrameHeader",
    "Int16",
    "Int32",
    "Int64",
    "Interval",
    "IntervalKind",
    "Laser",
    "LaserError",
    "LimitError",
    "LinearArray",
    "LocalMaxima",
    "MarkerCurve",
    "MarkerPosition",
    "MarkerseekError",
    "Measured",
    "MissingExtraError",
    "MoveError",
    "NotConnectedError",
    "NotFound",
    "OtherSource",
    "PaImage",
    "Permit",
    "Policy",
    "RFFrame",
    "Reader",
    "Reading",
    "ReadingError",
    "ReadingFrame",
    "Receiver",
    "RecordError",
    "Refused",
    "RigFacts",
    "RigKind",
    "Role",
    "Sample",
    "SaturationError",
    "ScanGeometry",
    "SearchError",
    "SearchPlan",
    "Stage",
    "Started",
    "UInt8",
    "Unsure",
    "as_interval",
    "is_finite",
    "is_whole",
    "marker_position",
    "needs_package",
    "require_range",
]
