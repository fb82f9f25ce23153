"""A stage node of another lab, in plain rclpy, with the manners that it is started with.

``sensor_stage.py [--joint NAME] [--state sensor|latched|on-change] [--stamp now|zero|simulated] [--beside NAME]``: name
of its joint; how it publishes its state (all topics have the QoS of sensors otherwise, which is best effort); what
stamps its angles; name of a joint that stands still, in messages of its own on the same topic.
"""

import argparse
import json
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, String

SPEED_RAD_S = 0.2
STATES = {
    "sensor": qos_profile_sensor_data,
    "latched": QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    "on-change": QoSProfile(depth=10),
}


class SensorStage:
    def __init__(self, node, manners):
        self.node = node
        self.manners = manners
        self.angle_rad = 0.0
        self.target_rad = 0.0
        self.steps = 0
        self.published = None
        self.measured = node.create_publisher(JointState, "/arm/measured_js", qos_profile_sensor_data)
        self.state = node.create_publisher(String, "/arm/state", STATES[manners.state])
        node.create_subscription(JointState, "/arm/move_jp", self.go, qos_profile_sensor_data)
        node.create_subscription(Empty, "/arm/stop", self.stop, 10)
        node.create_timer(0.02, self.step)

    def go(self, message):
        if list(message.name) == [self.manners.joint]:
            self.target_rad = message.position[0]

    def stop(self, _message):
        self.target_rad = self.angle_rad

    def step(self):
        self.steps += 1
        step_rad = 0.02 * SPEED_RAD_S
        self.angle_rad += max(-step_rad, min(step_rad, self.target_rad - self.angle_rad))
        now = self.node.get_clock().now().to_msg()
        message = JointState(name=[self.manners.joint], position=[self.angle_rad])
        if self.manners.stamp == "now":
            message.header.stamp = now
        elif self.manners.stamp == "simulated":
            message.header.stamp.sec = 1 + self.steps // 50
        self.measured.publish(message)
        if self.manners.beside:
            self.measured.publish(JointState(header=message.header, name=[self.manners.beside], position=[0.7]))
        busy = self.angle_rad != self.target_rad
        if self.manners.state != "sensor" and busy == self.published:
            return
        # A node that keeps nothing has said its first state before anybody listened.
        if self.manners.state == "on-change" and self.published is None and self.steps < 2:
            self.published = busy
            return
        self.published = busy
        # Stamped as the angle that belongs to it.
        state = {"state": "ENABLED", "is_homed": True, "is_busy": busy}
        self.state.publish(String(data=json.dumps({**state, "stamp_ns": now.sec * 10**9 + now.nanosec})))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--joint", default="trus_roll")
    parser.add_argument("--state", default="sensor", choices=STATES)
    parser.add_argument("--beside")
    parser.add_argument("--stamp", default="now", choices=["now", "zero", "simulated"])
    manners = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node("arm")
    SensorStage(node, manners)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    ends_s = time.monotonic() + 60.0
    while time.monotonic() < ends_s:
        rclpy.spin_once(node)


if __name__ == "__main__":
    main()
