"""Names of topics and services, as in CRTK (dVRK) where it has one; angles are in radians, lengths in metres."""

from __future__ import annotations


def in_namespace(name: str) -> str:
    """Return the name of a topic or service as its node asks for it: what is ours lies in the namespace of the node."""
    return name[1:] if name.startswith(("/TRUS/", "/pa_search/", "/pa_follow/")) else name


def beside(name: str, neighbour: str) -> str:
    """Return a topic in the namespace of another, such as the stop beside a node's command topic."""
    return f"{name.rpartition('/')[0]}/{neighbour.rpartition('/')[2]}"


MEASURED_JS = "/TRUS/measured_js"
SETPOINT_JS = "/TRUS/setpoint_js"
"""Angle read back, and angle asked for: sensor_msgs/JointState, joint ``trus_roll``."""

MOVE_JP = "/TRUS/move_jp"
"""Command to a stage node: go to an angle and rest there. sensor_msgs/JointState."""

STOP = "/TRUS/stop"
HOLD = "/TRUS/hold"
"""Stop now, by our name and by that of CRTK: std_msgs/Empty, to a stage node; without a stamp: it is never too late."""

STATE = "/TRUS/state"
"""State of a stage node: std_msgs/String with `messages.OperatingState` as JSON."""

ACQUIRE = "/TRUS/pa/acquire"
ACQUIRED = "/TRUS/pa/acquired"
CHANNELS = "/TRUS/pa/channels"
"""Request to an acquisition node and its answers: std_msgs/String with JSON; channel data: sensor_msgs/Image, 16SC1."""

ACQUISITION_STATE = "/TRUS/pa/state"
"""What an acquisition node is, latched: std_msgs/String with JSON, ``simulated``."""

FRAMES = "/tf"
"""tf2_msgs/TFMessage if it is installed, else geometry_msgs/TransformStamped."""

PICTURE = "/TRUS/pa/image"
ENVELOPE = "/TRUS/pa/envelope"
"""Photoacoustic image to be looked at (mono8) and to be calculated with (32FC1): sensor_msgs/Image."""

REGISTRATION = "/pa_search/registration"
STATIC_FRAMES = "/tf_static"
"""The camera of the da Vinci system in the home frame of the probe, latched, as geometry_msgs/TransformStamped, and for
tf2 with the type of `FRAMES`; that of a session is not static, and is sent on `FRAMES` while it holds."""

REGISTRATION_STATE = "/pa_search/registration_state"
"""Whether the registration holds, and its errors, latched: std_msgs/String with JSON."""

FOLLOW_STATE = "/pa_follow/state"
"""How a run that follows stands, latched: std_msgs/String with JSON."""

FOLLOW_STOP = "/pa_follow/stop"
"""Hold the probe in the dark until a person lets it go on: std_msgs/Empty; without a stamp: it is never too late."""

BANK = "/pa_search/bank"
SAMPLE = "/pa_search/sample"
INTENSITY = "/pa_search/intensity"
"""What is known of the rig, latched; each acquisition as JSON; its intensity as std_msgs/Float64."""

RUN = "/pa_search/run"
CANCEL = "/pa_search/cancel"
RESULT = "/pa_search/result"
"""Services of the search node, std_srvs/Trigger, and its latched answer: std_msgs/String with JSON."""
