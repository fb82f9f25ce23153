"""A ROS 2 node: publishers, subscriptions and triggers by name, spun by its owner's thread; the one user of rclpy."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from markerseek._closing import Closing
from markerseek.core import ConfigError, needs_package
from markerseek.ros import messages
from markerseek.ros.topics import in_namespace

_LOG = logging.getLogger(__name__)

_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
_MIDDLEWARE = "RMW_IMPLEMENTATION"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


_SHOWN = 120
"""Most of a message's content in a trace, in characters."""


def _note(topic: str, direction: str, message: Any) -> None:
    """Log a message; it is put into words only where somebody reads the log, because an image takes long."""
    if _LOG.isEnabledFor(logging.DEBUG):
        _LOG.debug("%s %s %s", topic, direction, message_text(message))


def message_text(message: Any) -> str:
    """Return the kind of a message, its time, and its numbers or text; of long ones only their number."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    at = "" if stamp is None else f" stamped {stamp.sec}.{stamp.nanosec:09}"
    content = next((getattr(message, name) for name in ("position", "data") if hasattr(message, name)), "")
    is_long = not isinstance(content, str) and hasattr(content, "__len__") and len(content) > _SHOWN
    text = f"{len(content)} values" if is_long else str(content)
    return f"{type(message).__name__}{at} {text[:_SHOWN]}".rstrip()


def set_up_discovery() -> str:
    """Keep to this computer, unless the user chose a transport; returns where nodes are looked for.

    Where the user has no profiles of the middleware, ours notices soon that a process is gone.
    """
    local, lease = (str(Path(__file__).with_name(name)) for name in ("local.xml", "participant.xml"))
    chosen = os.environ.get(_TRANSPORTS)
    foreign = next((name for name in _PROFILES if os.environ.get(name) not in (None, "", local, lease)), None)
    if foreign is None:
        os.environ[_PROFILES[0]] = lease if chosen else local
    middleware = os.environ.get(_MIDDLEWARE) or "rmw_fastrtps_cpp"
    if not middleware.startswith("rmw_fastrtps"):
        where = f"as {middleware} is set up ({_MIDDLEWARE})"
    elif foreign is not None:
        where = f"as {os.environ[foreign]} says ({foreign})"
    elif chosen == "SHM":
        where = f"in shared memory only ({_TRANSPORTS}=SHM), where nodes of default settings are not; unset it"
    elif chosen:
        where = f"by {_TRANSPORTS}={chosen}"
    else:
        where = f"on this computer only (127.0.0.1 and shared memory); {_TRANSPORTS}=DEFAULT opens the network"
    limit = f", {_RANGE}={os.environ[_RANGE]}" if os.environ.get(_RANGE) else ""
    return f"ROS 2 domain {os.environ.get('ROS_DOMAIN_ID') or 0} (ROS_DOMAIN_ID){limit}, {where}"


MOST_DOMAIN = 232
"""Largest number of a ROS 2 domain: the ports of those above do not exist."""


def require_domain() -> None:
    """Refuse a ROS_DOMAIN_ID that is no domain: the middleware prints errors of its own, and goes on without one."""
    given = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (given.isascii() and given.isdigit() and int(given) <= MOST_DOMAIN):
        raise ConfigError(f"ROS_DOMAIN_ID is {given!r}, it must be a whole number from 0 to {MOST_DOMAIN}; correct it")


def _keep_logs_somewhere() -> None:
    """Name a folder for the logs of ROS 2 where HOME is not set: it would refuse to start."""
    if not os.environ.get("HOME"):
        home = os.path.expanduser("~")  # noqa: PTH111  pathlib raises an error where there is none
        os.environ.setdefault("ROS_LOG_DIR", str(Path(tempfile.gettempdir() if home == "~" else home, ".ros", "log")))


def require_middleware() -> None:
    """Refuse a middleware that is not installed: rclpy ends the process as it is imported."""
    wanted = os.environ.get(_MIDDLEWARE)
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    index = "share/ament_index/resource_index/rmw_typesupport"
    found = {file.name for prefix in prefixes if prefix for file in Path(prefix, index).glob("rmw_*")}
    installed = sorted(found - {"rmw_implementation"})
    if wanted and installed and wanted not in installed:
        raise ConfigError(
            f"{_MIDDLEWARE} is {wanted}, which is not installed here ({', '.join(installed)} is); unset {_MIDDLEWARE}, "
            "or install that package"
        )


class DuplicateFilter:
    """Accepts each message once, and refuses a message that is older than the last of its publisher.

    A reliable and a best-effort subscription both receive from a reliable publisher. The reliable subscription receives
    a message later if it was sent again: a move must not come after the stop that followed it.
    """

    def __init__(self) -> None:
        self._last: dict[bytes, int] = {}
        self._recent: deque[tuple[int, int | None]] = deque(maxlen=1000)

    def is_new(self, info: Mapping[str, Any]) -> bool:
        """Return whether a message is accepted, by what rclpy says of it."""
        publisher = info.get("publisher_gid")
        number = info.get("publication_sequence_number")
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


_LAST_S = 1.0
"""Longest wait for subscribers when a node leaves, in seconds."""

_FOUND_S = 1.5
"""Time in which nodes on one computer find one another, in seconds."""

_DEPTH = 10
"""Messages that wait for a subscriber."""

_GONE_S = 2.0
"""Time after which a process that was killed is forgotten, in seconds; our profiles of the middleware have less."""


class Network:
    """What the nodes of one process share: connection, executor, and the number of messages received.

    ``arguments``: those of the user after ``--ros-args``: a namespace, other names.
    """

    def __init__(self, *, arguments: Sequence[str] = ()) -> None:
        require_domain()
        set_up_discovery()
        require_middleware()
        _keep_logs_somewhere()
        with needs_package("rclpy", extra="ros2", purpose="ROS 2"):
            import rclpy
            from rclpy.context import Context
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.signals import SignalHandlerOptions
        ours = ["--disable-rosout-logs", "--log-level", "error"]
        self.context = Context()
        try:
            # Signals stay with the command: it stops the rig first.
            rclpy.init(
                args=["--ros-args", *ours, *arguments],
                context=self.context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
        except RuntimeError as problem:
            raise _as_config_error(problem) from problem
        self.executor = SingleThreadedExecutor(context=self.context)
        self.handled = 0
        self.nodes = 0


class RosNode(Closing):
    """A node; use it as a context manager.

    Everything happens in the thread that calls `spin`; only `wake` may be called by others.

    ``name``: its name, without a namespace. ``network``: that of another node of this process, which is then spun for
    both; None for one of its own.
    """

    def __init__(self, name: str, *, network: Network | None = None) -> None:
        self.network = network or Network()
        self.name = name
        from rclpy.node import Node

        try:
            # Each service costs in every wait.
            self._node = Node(name, context=self.network.context, start_parameter_services=False, enable_rosout=False)
        except RuntimeError as problem:
            raise _as_config_error(problem) from problem
        if self._node.get_parameter("use_sim_time").value:
            raise ConfigError("use_sim_time is true; a rig keeps the computer's time: leave it out")
        self.network.executor.add_node(self._node)
        self.network.nodes += 1
        self._publishers: dict[str, Any] = {}
        self._subscriptions: dict[str, list[Any]] = {}
        self._open = True

    def advertise(self, topic: str, kind: str, *, latched: bool = False) -> None:
        """Make a publisher, so that subscribers can find it before the first message.

        ``topic``, ``kind``: topic, and name of the message, such as ``std_msgs/msg/String``. ``latched``: whether the
        last message is kept for subscribers that come later.
        """
        self._publishers[topic] = self._node.create_publisher(
            messages.kind(kind), in_namespace(topic), _quality(latched=latched)
        )

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message on a topic that was advertised."""
        _note(topic, ">", message)
        self._publishers[topic].publish(message)

    def subscribe(
        self,
        topic: str,
        kind: str,
        callback: Callable[[Any], None],
        *,
        latched: bool = False,
        command: bool = False,
    ) -> None:
        """Call a function once with each message of a topic, while the node is spun, whatever QoS its publisher has.

        ``latched``: whether its publisher keeps the last message for those who come later. ``command``: whether the
        first message of a best-effort publisher counts: a second subscription is there from the start, and not only
        when such a publisher appears.
        """
        from rclpy.event_handler import SubscriptionEventCallbacks

        duplicates = DuplicateFilter()
        made = self._subscriptions[topic] = []

        def take(message: Any, info: Mapping[str, Any]) -> None:
            self.network.handled += 1
            if duplicates.is_new(info):
                _note(topic, "<", message)
                callback(message)

        def add(wanted: Any) -> None:
            events = SubscriptionEventCallbacks(
                incompatible_qos=None if made else on_unfit, use_default_callbacks=False
            )
            made.append(
                self._node.create_subscription(
                    messages.kind(kind), in_namespace(topic), take, wanted, event_callbacks=events
                )
            )

        def on_unfit(_event: Any) -> None:
            if len(made) == 1:
                add(_quality(reliable=False))

        # A best-effort subscription alone would match every publisher, and lose messages of the reliable ones.
        add(_quality(latched=latched))
        if command:
            add(_quality(reliable=False))

    def serve(self, service: str, answer: Callable[[], tuple[bool, str]]) -> None:
        """Serve a std_srvs/Trigger.

        ``answer``: called for each request; whether it was carried out, and a sentence.
        """

        def reply(_request: Any, response: Any) -> Any:
            response.success, response.message = answer()
            return response

        self._node.create_service(messages.kind("std_srvs/srv/Trigger"), in_namespace(service), reply)

    def matched(self, topic: str) -> bool:
        """Return whether somebody listens to a topic that this node publishes."""
        return bool(self._publishers[topic].get_subscription_count() > 0)

    def publishes(self, topic: str) -> bool:
        """Return whether somebody publishes a topic that this node listens to."""
        return any(each.get_publisher_count() > 0 for each in self._subscriptions.get(topic, ()))

    def is_kept(self, topic: str) -> bool:
        """Return whether somebody publishes a topic and keeps the last message for those who come later."""
        from rclpy.qos import DurabilityPolicy

        publishers = self._node.get_publishers_info_by_topic(self._resolved(topic))
        return any(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in publishers)

    def kind_of(self, topic: str) -> str | None:
        """Return the type of what somebody publishes on a topic; None if nobody does."""
        found = self._node.get_publishers_info_by_topic(self._resolved(topic))
        return found[0].topic_type if found else None

    def other(self, topic: str) -> str | None:
        """Return another node that does the same work: of the same name, or a publisher of its topic; None without one.

        ``topic``: what only nodes like this one publish.
        """
        name = self._node.get_name()
        namespace = self._node.get_namespace()
        named = self._node.get_node_names_and_namespaces().count((name, namespace))
        resolved = self._resolved(topic)
        publishers = self._node.count_publishers(resolved)
        if named <= 1 and publishers <= (topic in self._publishers):
            return None
        return f"{named} nodes are named {name}, and {publishers} publish {resolved}"

    def require_alone(self, topic: str) -> None:
        """Refuse to be the second node that does the same work, as two on one command would both carry it out."""
        began_s = time.monotonic()
        other = None
        while (waited_s := time.monotonic() - began_s) < _FOUND_S or (other and waited_s < _GONE_S):
            # One that was killed a moment ago is forgotten soon.
            other = self.other(topic)
            self.spin(0.02)
        if other:
            raise ConfigError(f"{other}: end the other, or use another namespace: --ros-args -r __ns:=/other")

    def _resolved(self, topic: str) -> str:
        return str(self._node.resolve_topic_name(in_namespace(topic)))

    def spin(self, timeout_s: float) -> None:
        """Carry out what has arrived; waits for it at most so long."""
        self.network.executor.spin_once(timeout_sec=timeout_s)

    def drain(self, most: int) -> None:
        """Carry out what has arrived already, at most a number of messages, without waiting."""
        for _ in range(most):
            before = self.network.handled
            self.spin(0.0)
            if self.network.handled == before:
                break

    def wake(self) -> None:
        """Let `spin` return now; allowed in any thread."""
        if self._open:
            self.network.executor.wake()

    def now_s(self) -> float:
        """Return the seconds since 1970, for stamps; a deadline is on a monotonic clock."""
        return time.time()  # noqa: TID251  the time of day is what stamps hold; the node's clock can be set by others

    def close(self) -> None:
        """Leave the network; allowed twice."""
        if not self._open:
            return
        self._open = False
        self._hand_over()
        self.network.executor.remove_node(self._node)
        self._node.destroy_node()
        self.network.nodes -= 1
        if self.network.nodes == 0:
            self.network.executor.shutdown()
            self.network.context.try_shutdown()

    def _hand_over(self) -> None:
        """Wait until subscribers have what was published last, such as an answer: it would be lost with the node."""
        from rclpy.duration import Duration

        left_s = _LAST_S
        for publisher in self._publishers.values():
            began_s = time.monotonic()
            publisher.wait_for_all_acked(Duration(seconds=left_s))
            left_s = max(0.0, left_s - (time.monotonic() - began_s))


def _as_config_error(problem: RuntimeError) -> ConfigError:
    """Return an error of rcl, which names no cure; most come from the environment variables of ROS."""
    reason = " ".join(str(problem).split())
    cure = "check what follows --ros-args, and the environment variables ROS_*, RMW_IMPLEMENTATION and FASTDDS_*"
    if "security libraries" in reason:
        cure = "the wheels of PyPI have no SROS 2: use the ROS 2 of a distribution"
    return ConfigError(f"ROS 2 cannot start: {reason}; {cure}")


def _quality(*, latched: bool = False, reliable: bool = True) -> Any:
    """``latched``: the last message is kept for subscriptions that come later."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=1 if latched else _DEPTH,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
    )
