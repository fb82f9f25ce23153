"""The search as a ROS 2 node: services start and cancel it, topics carry its acquisitions and its answer."""

from __future__ import annotations

import queue
import threading
from typing import Any

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.child import ChildRun, Outcome
from markerseek.bridges.ros2.sample_topics import SampleTopics
from markerseek.bridges.ros2.serving import Diagnostics
from markerseek.bridges.searches import Searches
from markerseek.core import Failed, Measured, RecordError, Refused, SearchError
from markerseek.records.journal import Configuration, Entry, JournalItem
from markerseek.ros import RosNode, messages, topics


class SearchNode:
    """Runs searches as child processes, one at a time.

    ``asked``: the search; a std_srvs/Trigger carries nothing. ``publishes_angle``: whether the angle
    of the probe is published: not if the rig is one of ROS 2 nodes, of which one does it.
    """

    def __init__(self, *, node: RosNode, searches: Searches, asked: AskedSearch, publishes_angle: bool = True) -> None:
        self.node = node
        self.outcome: Outcome | None = None
        self._searches, self._asked = searches, asked
        self._topics = SampleTopics(node=node, publishes_angle=publishes_angle)
        self._child: ChildRun | None = None
        self._items: queue.SimpleQueue[JournalItem | Outcome] = queue.SimpleQueue()
        self._counts = {"searches": 0, "acquisitions": 0, "refused": 0}
        self._fault: str | None = None
        self._diagnostics = Diagnostics(node)
        node.advertise(topics.RESULT, "std_msgs/msg/String", latched=True)
        node.serve(topics.RUN, self._on_run)
        node.serve(topics.CANCEL, self._on_cancel)
        self._publish_result({"state": "idle"})

    def _on_run(self) -> tuple[bool, str]:
        # Both nodes hear the request, and both would begin.
        if (other := self.node.other(topics.RESULT)) is not None:
            return False, f"{other}: end one of them"
        try:
            self.start(asked_by=f"a ROS 2 node that called {topics.RUN} (ROS 2 does not tell which)")
        except SearchError as refusal:
            return False, str(refusal)
        return True, f"a search has begun; its answer comes on {topics.RESULT}"

    def _on_cancel(self) -> tuple[bool, str]:
        if self._searches.cancel():
            return True, "the search is being stopped"
        return False, "no search is running"

    @property
    def running(self) -> bool:
        """Whether a search is running, or its answer is not published yet."""
        return self._child is not None

    def start(self, *, asked_by: str | None = None) -> None:
        """Start a search, as `Searches.start` does; `SearchError` if one is running."""
        if self.running:
            raise SearchError("a search is running; cancel it, or wait for its result")
        self._child = self._searches.start(self._asked, asked_by=asked_by)
        self.outcome = None
        self._counts["searches"] += 1
        self._publish_result({"state": "running", "process_id": self._child.process_id})
        threading.Thread(target=self._read, args=(self._child,), daemon=True).start()

    def _read(self, child: ChildRun) -> None:
        """Follow the child in a thread of its own: waiting there must not hold up the network."""
        try:
            for item in child.items():
                self._items.put(item)
                self.node.wake()
        except RecordError:
            child.stop()
        self._items.put(child.outcome())
        self.node.wake()

    def step(self) -> None:
        """Publish what has happened since."""
        # Nobody else takes items out.
        while not self._items.empty():
            self._publish(self._items.get())
        self._diagnostics.step(fault=self._fault, facts={"running": self.running, **self._counts})

    def close(self) -> None:
        """Stop the search that is running, and wait for its end."""
        self._searches.cancel()
        while self.running:
            self._publish(self._items.get())

    def _publish(self, item: JournalItem | Outcome) -> None:
        match item:
            case Configuration():
                self._topics.begin(item)
            case Entry(event=event, clock_s=clock_s):
                if isinstance(event, Measured):
                    self._counts["acquisitions"] += 1
                    self._topics.publish(event, clock_s=clock_s)
                self._counts["refused"] += isinstance(event, Refused | Failed)
            case Outcome():
                self._end(item)

    def _end(self, outcome: Outcome) -> None:
        self._child, self.outcome = None, outcome
        self._fault = outcome.message if outcome.failed else None
        self._publish_result(
            {"state": "ended", "exit_code": outcome.exit_code, "message": outcome.message, "result": outcome.answer}
        )

    def _publish_result(self, content: dict[str, Any]) -> None:
        self.node.publish(topics.RESULT, messages.text(content))
