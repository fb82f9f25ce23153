"""What the ROS 2 commands share: options, nodes with their keys, and how they are served and stopped."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.bridges.ros2 import Beat, PlainTopics
    from markerseek.ros import Network, RosNode

RequireSecurity = Annotated[
    bool, typer.Option("--require-security", help="End with exit code 2 unless ROS 2 is run with keys (SROS 2).")
]
PlainCommand = Annotated[
    str | None,
    typer.Option("--plain-command", help="Also take angles from this topic, std_msgs/Float64 without a stamp."),
]
PlainReached = Annotated[
    str | None, typer.Option("--plain-reached", help="Publish the angle reached on this topic, std_msgs/Float64.")
]
PlainUnit = Annotated[str, typer.Option("--plain-unit", help="Unit of the two plain topics: rad or deg.")]


def serve_until_stopped(beat: Beat) -> None:
    """Serve the devices until a signal comes, then make them safe."""
    from markerseek.bridges.ros2 import Interrupted, serve

    with stopping() as stopped:
        served = list(beat.served)

        def ended() -> bool:
            return bool(stopped)

        try:
            serve(served, until=ended)
        except Interrupted:
            # Between two steps there is nothing to interrupt.
            pass
        finally:
            beat.served = []
            for each in served:
                each.close()


@contextmanager
def stopping() -> Iterator[list[int]]:
    """A list that receives the number of the first signal: a node ends between two messages, not inside of one."""
    stopped: list[int] = []
    before = {
        number: signal.signal(number, lambda received, _frame: stopped.append(received))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ros_node(
    name: str,
    parameters: Mapping[str, float | str | int | bool],
    *,
    require_security: bool,
    on_active: Callable[[bool], None] | None = None,
    network: Network | None = None,
) -> Iterator[RosNode]:
    """A node as of `markerseek.ros.RosNode`, with its keys checked where that is wanted."""
    from markerseek.ros import RosNode, require_keys

    enclave = f"/markerseek/{name}"
    if require_security:
        require_keys(enclave)
    with RosNode(name, parameters=parameters, enclave=enclave, on_active=on_active, network=network) as node:
        yield node


def follow_lifecycle(beat: Beat, index: int) -> Callable[[bool], None]:
    """What a node's change of state does to the device that it serves; before it serves one, nothing."""

    def set_active(active: bool) -> None:
        if beat.served:
            beat.served[index].set_active(active)

    return set_active


def plain_topics(command: str | None, reached: str | None, unit: str) -> PlainTopics | None:
    """The topics of plain numbers, if both are named."""
    from markerseek.bridges.ros2 import PlainTopics

    if command is None and reached is None:
        return None
    if command is None or reached is None:
        raise ConfigError("--plain-command and --plain-reached belong together; name both topics, or neither")
    if unit == "rad":
        return PlainTopics(command=command, reached=reached, unit="rad")
    if unit == "deg":
        return PlainTopics(command=command, reached=reached, unit="deg")
    raise ConfigError(f"--plain-unit is {unit}, it must be rad or deg")
