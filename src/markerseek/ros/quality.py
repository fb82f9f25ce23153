"""Quality of service (QoS) of topics: copies of a message, and policies that do not fit."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Any

_FOREVER_NS = 2**63 - 1


class Once:
    """Accepts each message once, and none that is older than the last of its publisher.

    A reliable publisher is heard by a reliable and by a best-effort subscription. The reliable one is the later where a
    message was sent again: a move must not come after the stop that followed it.
    """

    def __init__(self) -> None:
        self._last: dict[bytes, int] = {}
        self._recent: deque[tuple[int, int | None]] = deque(maxlen=1000)

    def is_new(self, info: Mapping[str, Any]) -> bool:
        """Whether a message is accepted, by what rclpy says of it."""
        publisher, number = info.get("publisher_gid"), info.get("publication_sequence_number")
        if publisher is not None and number is not None:
            if number <= self._last.get(publisher["data"], -1):
                return False
            self._last[publisher["data"]] = number
            return True
        # Before ROS 2 Kilted rclpy does not say who published a message.
        key = info["source_timestamp"], number
        is_new = key not in self._recent
        self._recent.append(key)
        return is_new


def unfit(topic: str, policy: str, *, ours: Any, theirs: Iterable[Any], listens: bool) -> str:
    """What does not fit on a topic, whose it is, and what helps.

    ``policy``: its name in rclpy's QoSProfile. ``ours``, ``theirs``: endpoints of this node and of the other side.
    ``listens``: whether this node is the one that listens.
    """
    own = "another" if ours is None else _value(ours, policy)
    others = sorted({(each.node_name, value) for each in theirs if (value := _value(each, policy)) != own})
    who = " and ".join(f"the node {name} ({value})" for name, value in others) or "a node"
    policy = policy.replace("_", " ")
    if listens:
        return (
            f"{topic}: the {policy} of its publisher does not fit: {who}; it is heard, but a message can be lost; "
            f"publish with {policy} {own}"
        )
    return (
        f"{topic}: the {policy} that a subscription asks for does not fit: {who}; it hears nothing from here; "
        f"subscribe with {policy} {own}"
    )


def _value(endpoint: Any, policy: str) -> str:
    """A policy of an endpoint in a word."""
    value = getattr(endpoint.qos_profile, policy, None)
    if isinstance(value, Enum):
        return value.name.lower()
    nanoseconds = getattr(value, "nanoseconds", _FOREVER_NS)
    return "none" if nanoseconds >= _FOREVER_NS else f"{nanoseconds * 1e-9:g} s"
