"""What the ROS 2 commands share: options, nodes with their keys, and how they are served and stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated

import typer

from markerseek import ros
from markerseek.bridges import ros2
from markerseek.cli.signals import noted_signals
from markerseek.core import ConfigError

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


def serve_until_stopped(pump: ros2.MessagePump) -> None:
    """Serve the devices until a signal comes, then make them safe."""
    with noted_signals() as stopped:
        served = list(pump.served)
        try:
            ros2.serve(served, until=lambda: bool(stopped))
        except ros2.StepEnded:
            # Between two steps there is nothing to interrupt.
            pass
        finally:
            pump.served = []
            for each in served:
                each.close()


@contextmanager
def ros_node(
    name: str,
    parameters: Mapping[str, float | str | int | bool],
    *,
    publishes: str,
    arguments: Sequence[str],
    require_security: bool,
    on_active: Callable[[bool], None] | None = None,
    network: ros.Network | None = None,
) -> Iterator[ros.RosNode]:
    """A node as of `markerseek.ros.RosNode`, with its keys checked where that is wanted.

    ``publishes``: what only nodes of this kind publish: there must be no second one. ``arguments``: those of the user
    after ``--ros-args``.
    """
    enclave = f"/markerseek/{name}"
    if require_security:
        ros.require_keys(enclave)
    network = network or ros.Network(enclave, arguments=arguments)
    with ros.RosNode(name, parameters=parameters, on_active=on_active, network=network) as node:
        node.require_alone(publishes)
        yield node


def follow_lifecycle(pump: ros2.MessagePump, index: int) -> Callable[[bool], None]:
    """Apply a node's change of state to its device; without a device nothing happens."""

    def set_active(active: bool) -> None:
        if pump.served:
            pump.served[index].set_active(active)

    return set_active


def plain_topics(command: str | None, reached: str | None, unit: str) -> ros2.PlainTopics | None:
    """The topics of plain numbers, if both are named."""
    if command is None and reached is None:
        return None
    if command is None or reached is None:
        raise ConfigError("--plain-command and --plain-reached belong together; name both topics, or neither")
    if unit not in ("rad", "deg"):
        raise ConfigError(f"--plain-unit is {unit}, it must be rad or deg")
    return ros2.PlainTopics(command=command, reached=reached, unit="rad" if unit == "rad" else "deg")
