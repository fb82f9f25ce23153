"""Laser and receiver as a ROS 2 node: it fires and records when asked, under a guard of its own."""

from __future__ import annotations

import math
from typing import Any

from markerseek.bridges.ros2.interrupted import Interrupted
from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    Laser,
    LimitError,
    MarkerseekError,
    Permit,
    Receiver,
)
from markerseek.guard import Guard
from markerseek.ros import RosNode, StampedCommands, degrees, messages, topics
from markerseek.scan import DeadMan

_TEXT = "std_msgs/msg/String"
_DIAGNOSE_S = 1.0


class AcquisitionNode:
    """Serves a laser and its receiver: one request fires at most the pulses of a permit of the guard here, and records.

    Parameters
    ----------
    node
        Its node.
    laser, receiver, guard, clock
        The devices, their guard, and their time.
    by
        Who has armed the guard.
    dead_man
        Lease of the laser, to be held while it fires.
    simulated
        Whether laser and receiver are simulated.
    """

    def __init__(
        self,
        *,
        node: RosNode,
        laser: Laser,
        receiver: Receiver,
        guard: Guard,
        clock: Clock,
        by: str,
        dead_man: DeadMan | None = None,
        simulated: bool = False,
    ) -> None:
        self.node = node
        self._laser, self._receiver, self._guard, self._clock, self._by = laser, receiver, guard, clock, by
        self._dead_man, self._simulated = dead_man, simulated
        self._commands = StampedCommands()
        self._wanted: messages.AcquireRequest | None = None
        self._acquiring = False
        self._cancelled = False
        self._settled = False
        self._active = True
        self._frames = self._errors = 0
        self._diagnose_s = -math.inf
        node.advertise(topics.ACQUIRED, _TEXT)
        node.advertise(topics.CHANNELS, "sensor_msgs/msg/Image")
        node.advertise(topics.DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")
        node.subscribe(topics.ACQUIRE, _TEXT, self._on_request)
        state = messages.text(node.kinds, messages.AcquisitionState(simulated=simulated))
        node.publish(topics.ACQUISITION_STATE, _TEXT, state, latched=True)

    def _on_request(self, message: Any) -> None:
        request = messages.request_of(message)
        if request is None:
            self._commands.drop("no request", "it holds no request")
            return
        if request.pulses == -1:
            # Needs no stamp: light that ends too early harms nobody.
            self._wanted, self._cancelled = None, self._acquiring
            return
        reason = self._commands.refusal(request.stamp_ns, now_s=self.node.now_s())
        if reason is None and (self._acquiring or self._wanted is not None):
            reason = self._commands.drop("busy", "an acquisition is going on; wait for its frame, or cancel it")
        if reason is not None:
            self._answer(request, error=reason)
            return
        self._wanted = request

    def set_active(self, active: bool) -> None:
        """Follow the lifecycle: a node that is deactivated ends its acquisition, and is disarmed until a new start."""
        if not active:
            self._active = False
            self._wanted, self._cancelled = None, self._acquiring
            self._guard.disarm()

    def beat(self) -> None:
        """End the acquisition if that is wanted; called while a device works, after the messages have been handled.

        Raises
        ------
        Interrupted
            If somebody cancels it.
        """
        if self._acquiring and self._cancelled:
            raise Interrupted

    def step(self) -> None:
        """Carry out the last request, and publish diagnostics when they are due."""
        self._cancelled = False
        request, self._wanted = self._wanted, None
        if request is not None:
            self._serve(request)
        if self.node.now_s() >= self._diagnose_s:
            self._diagnose_s = self.node.now_s() + _DIAGNOSE_S
            self._publish_diagnostics()

    def _serve(self, request: messages.AcquireRequest) -> None:
        self._acquiring = True
        try:
            self._acquire(request)
        except Interrupted:
            self._make_safe()
            self._guard.disarm()
            if self._active:
                # In the name of the same person: a cancellation does not end the session for which the node was armed.
                self._guard.arm(by=self._by)
            self._answer(request, error="it was cancelled")
        except (AcquisitionError, LimitError) as error:
            # The state is unchanged: the frame may be taken again, and a refused request fired nothing.
            self._answer(request, error=str(error))
        except MarkerseekError as error:
            self._guard.fail(f"{type(error).__name__}: {error}")
            self._make_safe()
            self._answer(request, error=str(error))
        finally:
            self._acquiring = False

    def _acquire(self, request: messages.AcquireRequest) -> None:
        angle_deg = degrees(request.angle_rad)
        # Only the search knows where the stage is; the guard here checks that the angle is one of its range.
        self._guard.limits.require_travel(angle_deg)
        if not self._settled:
            self._receiver.settle()
        self._settled = False
        permit = self._guard.issue(angle_deg=angle_deg, pulses=request.pulses, now_s=self._clock.now_s())
        self._receiver.arm(permit)
        self._guard.redeem(permit, angle_deg=angle_deg, now_s=self._clock.now_s())
        fired = self._fire(permit)
        self._guard.end_fire(fired)
        self._answer(request, step="fired", pulses=fired)
        frame = self._receiver.acquire(permit)
        if not isinstance(frame, ChannelFrame):
            raise AcquisitionError(f"receiver: it returned a {type(frame).__name__}, and channel data are served")
        self._settled = True
        self._frames += 1
        now_s = self.node.now_s()
        image = messages.channels(self.node.kinds, frame.samples, time_s=now_s)
        self.node.publish(topics.CHANNELS, "sensor_msgs/msg/Image", image)
        self._answer(
            request,
            step="frame",
            pulses=frame.header.pulses,
            sequence=frame.header.sequence,
            sampling_hz=frame.sampling_hz,
            stamp_ns=messages.time_ns(now_s),
        )

    def _fire(self, permit: Permit) -> int:
        if self._dead_man is not None:
            self._dead_man.hold()
        try:
            return self._laser.fire(permit)
        finally:
            if self._dead_man is not None:
                self._dead_man.release()

    def _answer(self, request: messages.AcquireRequest, *, error: str = "", step: Any = "error", **facts: Any) -> None:
        self._errors += step == "error"
        answer = messages.Acquired(id=request.id, step=step, error=error, simulated=self._simulated, **facts)
        self.node.publish(topics.ACQUIRED, _TEXT, messages.text(self.node.kinds, answer))

    def _make_safe(self) -> None:
        self._acquiring = False
        try:
            self._laser.disarm()
        except MarkerseekError as error:
            self._guard.fail(f"{type(error).__name__}: {error}")

    def close(self) -> None:
        """Disarm guard and laser."""
        self._guard.disarm()
        self._make_safe()

    def _publish_diagnostics(self) -> None:
        facts = {
            "state": self._guard.state.value,
            "simulated": self._simulated,
            "pulses permitted": self._guard.pulses_permitted,
            "frames": self._frames,
            "errors": self._errors,
            **{f"dropped: {reason}": count for reason, count in self._commands.dropped.items()},
        }
        message = messages.diagnostics(
            self.node.kinds, time_s=self.node.now_s(), name=self.node.name, fault=self._guard.fault, facts=facts
        )
        self.node.publish(topics.DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", message)
