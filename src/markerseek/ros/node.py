"""A ROS 2 node: publishers, subscriptions and triggers by name, spun by its owner's thread; the one user of rclpy."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Self

from markerseek.core import ConfigError, RecordError, needs_package
from markerseek.ros.kinds import Kinds

_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")

_LAST_S = 1.0
"""Longest wait for subscribers when a node leaves, in seconds."""

_DEPTH = 10
"""Messages that wait for a subscriber."""


def local_transport() -> str:
    """Choose shared memory, which opens no socket, unless the user chose a transport; returns what is used."""
    if not any(name in os.environ for name in _PROFILES):
        os.environ.setdefault(_TRANSPORTS, "SHM")
    return os.environ.get(_TRANSPORTS, "that of the profiles file")


class Network:
    """What the nodes of one process share: connection, executor, and the number of messages received.

    Parameters
    ----------
    enclave
        Name of its keys, where security is enforced.

    Raises
    ------
    MissingExtraError
        If ROS 2 is not installed.
    """

    def __init__(self, enclave: str | None = None) -> None:
        local_transport()
        with needs_package("rclpy", extra="ros2", purpose="ROS 2"):
            import rclpy
            from rclpy.context import Context
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.signals import SignalHandlerOptions
        arguments = ["--ros-args", "--disable-rosout-logs", "--log-level", "error"]
        if enclave is not None:
            arguments += ["--enclave", enclave]
        self.context = Context()
        try:
            # Signals stay with the command: it stops the rig first.
            rclpy.init(args=arguments, context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as problem:
            raise _as_config_error(problem) from problem
        self.executor = SingleThreadedExecutor(context=self.context)
        self.handled = 0
        self.nodes = 0


class RosNode:
    """A lifecycle node, active as soon as it is made; use it as a context manager.

    Everything happens in the thread that calls `spin`; only `wake` may be called by others.

    Attributes
    ----------
    network
        What it shares with other nodes of its process.
    name
        Its name.
    kinds
        Classes of messages by name.

    Parameters
    ----------
    name
        Its name, without a namespace.
    parameters
        Read-only parameters, such as limits; None for a node that only asks others, which has no services of its own.
    on_active
        Called with True and False when somebody activates or deactivates it.
    enclave
        Name of its keys, where security is enforced.
    network
        That of another node of this process, which is then spun for both; None for one of its own.

    Raises
    ------
    MissingExtraError
        If ROS 2 is not installed.
    """

    def __init__(
        self,
        name: str,
        *,
        parameters: Mapping[str, float | str | int | bool] | None = None,
        on_active: Callable[[bool], None] | None = None,
        enclave: str | None = None,
        network: Network | None = None,
    ) -> None:
        self.network = network or Network(enclave)
        self.kinds = Kinds()
        self.name = name
        from rcl_interfaces.msg import ParameterDescriptor
        from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

        notify = on_active or (lambda _active: None)

        class _Node(LifecycleNode):  # type: ignore[misc,unused-ignore]
            def on_activate(self, state: Any) -> Any:
                notify(True)
                return super().on_activate(state)

            def on_deactivate(self, state: Any) -> Any:
                notify(False)
                return super().on_deactivate(state)

            def on_cleanup(self, _state: Any) -> Any:
                return TransitionCallbackReturn.SUCCESS

            def on_shutdown(self, _state: Any) -> Any:
                notify(False)
                return TransitionCallbackReturn.SUCCESS

        try:
            # Each service costs in every wait, and who has no parameters serves nobody.
            serves = parameters is not None
            self._node = _Node(
                name,
                context=self.network.context,
                enable_communication_interface=serves,
                start_parameter_services=serves,
                enable_rosout=False,
            )
        except RuntimeError as problem:
            raise _as_config_error(problem) from problem
        for key, value in (parameters or {}).items():
            self._node.declare_parameter(key, value, ParameterDescriptor(read_only=True))
        self.network.executor.add_node(self._node)
        self.network.nodes += 1
        self._publishers: dict[str, Any] = {}
        self._subscriptions: list[Any] = []
        # `rclpy` creates its own publishers for `LifecycleNode.create_lifecycle_publisher`; ours publish in any state.
        self._node.trigger_configure()
        self._node.trigger_activate()
        self._open = True

    def advertise(self, topic: str, kind: str, *, latched: bool = False) -> None:
        """Make a publisher, so that subscribers can find it before the first message.

        Parameters
        ----------
        topic, kind
            Topic, and name of the message, such as ``std_msgs/msg/String``.
        latched
            Whether the last message is kept for subscribers that come later.
        """
        self._publishers[topic] = self._node.create_publisher(self.kinds.kind(kind), topic, _quality(latched=latched))

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message on a topic that was advertised."""
        self._publishers[topic].publish(message)

    def subscribe(self, topic: str, kind: str, callback: Callable[[Any], None], *, latched: bool = False) -> None:
        """Call a function with each message of a topic, while the node is spun."""

        def count(message: Any) -> None:
            self.network.handled += 1
            callback(message)

        self._subscriptions.append(
            self._node.create_subscription(self.kinds.kind(kind), topic, count, _quality(latched=latched))
        )

    def serve(self, service: str, answer: Callable[[], tuple[bool, str]]) -> None:
        """Serve a std_srvs/Trigger.

        Parameters
        ----------
        service
            Its name.
        answer
            Called for each request; whether it was carried out, and a sentence.
        """

        def reply(_request: Any, response: Any) -> Any:
            response.success, response.message = answer()
            return response

        self._node.create_service(self.kinds.kind("std_srvs/srv/Trigger"), service, reply)

    def call(self, service: str, *, timeout_s: float) -> tuple[bool, str]:
        """Call a std_srvs/Trigger of another node.

        Raises
        ------
        RecordError
            If nobody answers in time.
        """
        client = self._node.create_client(self.kinds.kind("std_srvs/srv/Trigger"), service)
        try:
            future = client.call_async(client.srv_type.Request()) if client.wait_for_service(timeout_s) else None
            if future is not None:
                self.network.executor.spin_until_future_complete(future, timeout_sec=timeout_s)
            if future is None or not future.done():
                raise RecordError(f"nobody answers on {service} within {timeout_s:g} s; start the node first")
            answer: Any = future.result()
            return bool(answer.success), str(answer.message)
        finally:
            self._node.destroy_client(client)

    def matched(self, topic: str) -> bool:
        """Whether somebody listens to a topic that this node publishes."""
        return bool(self._publishers[topic].get_subscription_count() > 0)

    def publishes(self, topic: str) -> bool:
        """Whether somebody publishes a topic that this node listens to."""
        return any(each.get_publisher_count() > 0 for each in self._subscriptions if each.topic_name == topic)

    def spin(self, timeout_s: float) -> None:
        """Carry out what has arrived; waits for it at most so long."""
        self.network.executor.spin_once(timeout_sec=timeout_s)

    def drain(self, most: int) -> None:
        """Carry out what has arrived already, at most so many messages, without waiting."""
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
        """Seconds since 1970 on the clock of ROS."""
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

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
            began_s = self.now_s()
            publisher.wait_for_all_acked(Duration(seconds=left_s))
            left_s = max(0.0, left_s - (self.now_s() - began_s))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()


def _as_config_error(problem: RuntimeError) -> ConfigError:
    """An error of rcl, which names no cure; most come from the environment variables of ROS."""
    reason = " ".join(str(problem).split())
    cure = "check the environment variables ROS_*, RMW_IMPLEMENTATION and FASTDDS_*"
    if "security libraries" in reason:
        cure = "the wheels of PyPI have no SROS 2: use the ROS 2 of a distribution"
    return ConfigError(f"ROS 2 cannot start: {reason}; {cure}")


def _quality(*, latched: bool) -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile

    if latched:
        return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return QoSProfile(depth=_DEPTH)
