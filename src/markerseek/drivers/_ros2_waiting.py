"""Waits for the nodes of ROS 2 that drive devices: until they are found, and until they answer."""

from __future__ import annotations

import logging
from collections.abc import Callable

from markerseek.core import Clock, NotConnectedError
from markerseek.ros import RosNode, set_up_discovery

_LOG = logging.getLogger(__name__)

_SLICE_S = 0.02
"""Longest time between two beats of the clock while a message is awaited, in seconds."""

_PATIENCE_S = 2.0
"""Time after which it is said that a node is not found yet, in seconds; on one computer it takes 0.3 s."""

STATE_S = 1.0
"""Longest wait for the state of a node that may not publish it now, in seconds."""


def require_found(
    node: RosNode, clock: Clock, found: Callable[[], bool], *, missing: str, cure: str, connect_s: float
) -> None:
    """Wait for a node of a rig, and warn early where it is looked for; `NotConnectedError` if it is not found in time.

    ``missing``: what was not found, as "stage: no node takes angles on /goto". ``cure``: what helps.
    """
    early_s = min(_PATIENCE_S, connect_s)
    if wait_until(node, clock, found, timeout_s=early_s):
        return
    where = f"it is looked for in {set_up_discovery()}"
    if connect_s > early_s:
        _LOG.warning("%s so far; %s; waiting up to %g s", missing, where, connect_s)
        if wait_until(node, clock, found, timeout_s=connect_s - early_s):
            return
    raise NotConnectedError(f"{missing} within {connect_s:g} s; {cure}; {where}")


def wait_until(node: RosNode, clock: Clock, arrived: Callable[[], bool], *, timeout_s: float, of: str = "") -> bool:
    """Return whether a condition came true in time; meanwhile the node is spun, and the clock beats.

    ``arrived``: the condition, which messages change. ``timeout_s``: longest time. ``of``: topic of the node that is
    waited for; empty while it is looked for. Raises `NotConnectedError` if nobody publishes its topic any more: it has
    ended, or was killed.
    """
    ends_s = clock.now_s() + timeout_s
    while not arrived():
        if not clock.now_s() < ends_s:
            return False
        if of and not node.publishes(of):
            raise NotConnectedError(f"its node is gone: nobody publishes {of} any more; start it again")
        node.spin(_SLICE_S)
        clock.wait(0.0)
    return True
