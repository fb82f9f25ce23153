"""The SROS 2 policy names what running nodes have, no more and no less: with keys, a node may make nothing else."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek import rigs
from markerseek.bridges import Searches, SearchOptions, SearchRequest
from markerseek.bridges.ros2 import SearchNode, StageNode, publish_registration
from markerseek.drivers import Ros2Acquisition, Ros2Stage, Ros2StageSettings, RosReceiver, SystemClock
from markerseek.geometry import RigidTransform
from markerseek.ros import RosNode, topics
from markerseek.runs import KnownRegistration
from tests.ros2.simulated_acquisition import acquisition_of, armed_guard

CRTK = {topics.OPERATING_STATE, topics.STATE_COMMAND, topics.ERROR, topics.WARNING}
POLICY = Path(__file__).parents[2] / "examples" / "ros2-policy.xml"
KINDS = {
    ("topics", "publish"): "get_publisher_names_and_types_by_node",
    ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
    ("services", "reply"): "get_service_names_and_types_by_node",
    ("services", "request"): "get_client_names_and_types_by_node",
}


def allowed(node: str, kind: tuple[str, str]) -> set[str]:
    """Full names that the policy allows a node."""
    profile = ET.parse(POLICY).find(f".//profile[@node='{node}']")
    names = [each.text for group in profile.findall(f"{kind[0]}[@{kind[1]}='ALLOW']") for each in group]
    full = {f"/{node}/{name[1:]}" if name.startswith("~") else f"/{name}" for name in names}
    # A stage node has CRTK's topics where crtk_msgs is installed.
    return full if find_spec("crtk_msgs") else full - CRTK


def test_each_node_has_what_the_policy_allows_it_and_nothing_else() -> None:
    world = rigs.simulated(seed=1)
    guard = armed_guard(world)
    nobody = RigidTransform(source="DaVinci", target="ProbeHome", rotation=np.eye(3), translation_m=np.zeros(3))
    with ExitStack() as opened:

        def node(name: str, **options: object) -> RosNode:
            return opened.enter_context(RosNode(name, **options))

        stage_node = node("trus_stage", parameters={"simulated": True})
        network = stage_node.network
        acquisition_node = node("trus_acquisition", parameters={"simulated": True}, network=network)
        search_node = node("pa_search", parameters={"method": "posterior"}, network=network)
        rig_node = node("markerseek_rig", network=network)
        served = StageNode(node=stage_node, stage=world.stage, guard=guard, by="a test")
        acquisition_of(world, node=acquisition_node, guard=guard)
        publish_registration(
            search_node,
            KnownRegistration(name="a", davinci_to_trus=nobody, simulated=False, fre_m=0.0, tre_m=0.0),
        )
        SearchNode(node=search_node, searches=Searches(SearchOptions()), request=SearchRequest())
        clock = SystemClock(beat=served.step)
        Ros2Stage(node=rig_node, clock=clock, settings=Ros2StageSettings(), travel=world.limits.search)
        Ros2Acquisition(node=rig_node, clock=clock, settings=RosReceiver())
        for name in ("trus_stage", "trus_acquisition", "pa_search", "markerseek_rig"):
            for kind, question in KINDS.items():
                ask: Callable[[str, str], list[tuple[str, list[str]]]] = getattr(rig_node._node, question)
                assert {topic for topic, _types in ask(name, "/")} == allowed(name, kind), (name, kind)
