"""The search as a ROS 2 node: services start and cancel it, topics carry its acquisitions and its answer."""

from __future__ import annotations

import queue
from typing import Any

from markerseek.bridges.child import Searches, SearchOptions
from markerseek.bridges.outcome import Outcome
from markerseek.bridges.request import SearchRequest
from markerseek.bridges.ros2.sample_topics import SampleTopics
from markerseek.bridges.run_images import PicturedItem
from markerseek.core import SearchError, plain
from markerseek.records.journal import Configuration
from markerseek.ros import RosNode, messages, topics


class SearchNode:
    """Runs searches as child processes, one at a time.

    ``asked``: the search; a std_srvs/Trigger carries nothing. ``publishes_angle``: whether the angle of the probe is
    published; a rig of ROS 2 nodes has a stage node that publishes the angle.
    """

    def __init__(
        self, *, node: RosNode, options: SearchOptions, asked: SearchRequest, publishes_angle: bool = True
    ) -> None:
        self.node = node
        self._asked = asked
        self.outcome: Outcome | None = None
        self.running = False
        """Whether a search runs, or its answer is not published yet."""
        self._searches = Searches(options, on_start=self._started, on_item=self._queued, on_end=self._queued)
        self._topics = SampleTopics(node=node, publishes_angle=publishes_angle)
        self._items: queue.SimpleQueue[PicturedItem | Outcome] = queue.SimpleQueue()
        node.advertise(topics.RESULT, "std_msgs/msg/String", latched=True)
        node.serve(topics.RUN, self._on_run)
        node.serve(topics.CANCEL, self._searches.stop)
        self._publish_result({"state": "idle"})

    def _on_run(self) -> tuple[bool, str]:
        # Both nodes receive the request, and both would begin.
        if (other := self.node.other(topics.RESULT)) is not None:
            return False, f"{other}: end one of them"
        try:
            self.start(asked_by=f"a ROS 2 node that called {topics.RUN} (ROS 2 does not tell which)")
        except SearchError as refusal:
            return False, plain(str(refusal))
        return True, f"a search has begun; its answer comes on {topics.RESULT}"

    def start(self, *, asked_by: str | None = None) -> None:
        """Start a search; errors as of `Searches.start`."""
        self.step()
        self._searches.start(self._asked, asked_by=asked_by)

    def _started(self, process_id: int) -> None:
        self.running = True
        self.outcome = None
        self._publish_result({"state": "running", "process_id": process_id})

    def _queued(self, item: PicturedItem | Outcome) -> None:
        # Only the thread that spins the node may publish.
        self._items.put(item)
        self.node.wake()

    def step(self) -> None:
        """Publish what has happened since."""
        while not self._items.empty():
            item = self._items.get()
            if isinstance(item, Outcome):
                self._end(item)
            elif isinstance(item, Configuration):
                self._topics.begin(item)
            else:
                self._topics.publish(item)

    def close(self) -> None:
        """Stop the search that runs, and publish its end."""
        self._searches.close()
        self.step()

    def _end(self, outcome: Outcome) -> None:
        self.running = False
        self.outcome = outcome
        self._publish_result(
            {"state": "ended", "exit_code": outcome.exit_code, "message": outcome.message, "result": outcome.printed}
        )

    def _publish_result(self, content: dict[str, Any]) -> None:
        self.node.publish(topics.RESULT, messages.text(content))
