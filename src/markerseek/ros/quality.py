"""Copies of a message that two subscriptions of different quality of service (QoS) receive."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any


class Once:
    """Accepts each message once, and refuses a message that is older than the last of its publisher.

    A reliable and a best-effort subscription both receive from a reliable publisher. The reliable subscription receives
    a message later if it was sent again: a move must not come after the stop that followed it.
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
