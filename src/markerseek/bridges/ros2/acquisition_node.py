"""Laser and receiver as a ROS 2 node: it fires and records when asked, under a guard of its own."""

from __future__ import annotations

from typing import Any

from markerseek.bridges.ros2.serving import Served, Serving, StepEnded
from markerseek.core import AcquisitionError, ChannelFrame, Clock, Laser, LimitError, MarkerseekError, Receiver, plain
from markerseek.ros import degrees, messages, topics

_TEXT = "std_msgs/msg/String"


class AcquisitionNode(Served):
    """Serves a laser and its receiver: for each request it fires under a permit of its own guard, and records.

    The lease is renewed while the laser fires.
    """

    def __init__(self, serving: Serving, *, laser: Laser, receiver: Receiver, clock: Clock) -> None:
        super().__init__(serving)
        node = self.node
        self._laser = laser
        self._receiver = receiver
        self._clock = clock
        self._wanted: messages.AcquireRequest | None = None
        self._acquiring = False
        self._cancelled = False
        self._settled = False
        node.advertise(topics.ACQUIRED, _TEXT)
        node.advertise(topics.CHANNELS, "sensor_msgs/msg/Image")
        node.subscribe(topics.ACQUIRE, _TEXT, self._on_request, command=True)
        state = messages.text(messages.AcquisitionState(simulated=self._simulated))
        node.advertise(topics.ACQUISITION_STATE, _TEXT, latched=True)
        node.publish(topics.ACQUISITION_STATE, state)

    def _on_request(self, message: Any) -> None:
        request = messages.decoded(message.data, messages.AcquireRequest)
        if request is None:
            return
        if request.pulses == -1:
            # A cancellation needs no stamp: light that ends too early harms nobody.
            self.stop()
            return
        reason = self._commands.refusal(request.stamp_ns, now_s=self.node.now_s())
        if reason is None and (other := self.node.other(topics.ACQUIRED)) is not None:
            reason = f"{other}: both would fire; end one of them"
        if reason is None and (self._acquiring or self._wanted is not None):
            reason = "an acquisition is going on; wait for its frame, or cancel it"
        if reason is not None:
            self._answer(request, error=reason)
            return
        self._wanted = request

    def stop(self) -> None:
        """End the acquisition, and forget a request that has not begun."""
        self._wanted = None
        self._cancelled = self._acquiring

    def beat(self) -> None:
        """Raise `StepEnded` if somebody has cancelled the acquisition.

        Called while a device works, after the messages have been handled.
        """
        if self._acquiring and self._cancelled:
            raise StepEnded

    def step(self) -> None:
        """Carry out the last request."""
        self._cancelled = False
        request = self._wanted
        self._wanted = None
        if request is not None:
            self._serve(request)

    def _serve(self, request: messages.AcquireRequest) -> None:
        self._acquiring = True
        try:
            self._acquire(request)
        except StepEnded:
            self._end_interrupted()
            self._answer(request, error="it was cancelled")
        except (AcquisitionError, LimitError) as error:
            # The state is unchanged: the frame may be taken again, and a refused request fired nothing.
            self._answer(request, error=plain(str(error)))
        except MarkerseekError as error:
            self._fail(error)
            self._make_safe()
            self._answer(request, error=plain(str(error)))
        finally:
            self._acquiring = False

    def _acquire(self, request: messages.AcquireRequest) -> None:
        angle_deg = degrees(request.angle_rad)
        # Only the search knows where the stage is; the guard here checks that the angle is inside the travel.
        self._guard.limits.require_travel(angle_deg)
        if not self._settled:
            self._receiver.settle()
        self._settled = False
        permit = self._guard.issue(angle_deg=angle_deg, pulses=request.pulses, now_s=self._clock.now_s())
        self._receiver.arm(permit)
        self._guard.redeem(permit, angle_deg=angle_deg, now_s=self._clock.now_s())
        with self._lease_held():
            fired = self._laser.fire(permit)
        self._guard.end_fire(fired)
        self._answer(request, step="fired", pulses=fired)
        frame = self._receiver.acquire(permit)
        if not isinstance(frame, ChannelFrame):
            raise AcquisitionError(f"receiver: it returned a {type(frame).__name__}, and channel data are served")
        self._settled = True
        now_s = self.node.now_s()
        image = messages.channels(frame.samples, time_s=now_s)
        self.node.publish(topics.CHANNELS, image)
        self._answer(
            request,
            step="frame",
            pulses=frame.header.pulses,
            sequence=frame.header.sequence,
            sampling_hz=frame.sampling_hz,
            stamp_ns=messages.time_ns(now_s),
            energy=frame.header.energy,
        )

    def _answer(self, request: messages.AcquireRequest, *, error: str = "", step: Any = "error", **facts: Any) -> None:
        answer = messages.Acquired(id=request.id, step=step, error=error, simulated=self._simulated, **facts)
        self.node.publish(topics.ACQUIRED, messages.text(answer))

    def _make_safe(self) -> None:
        self._acquiring = False
        try:
            self._laser.disarm()
        except MarkerseekError as error:
            self._fail(error)
