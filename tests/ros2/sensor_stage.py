"""A stage node of another lab, in plain rclpy: all that it publishes has the QoS of sensors, which is best effort."""

import json
import sys
import time

import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, String

SPEED_RAD_S = 0.2


class SensorStage:
    def __init__(self, node):
        self.node = node
        self.angle_rad = self.target_rad = 0.0
        self.measured = node.create_publisher(JointState, "/arm/measured_js", qos_profile_sensor_data)
        self.state = node.create_publisher(String, "/arm/state", qos_profile_sensor_data)
        node.create_subscription(JointState, "/arm/move_jp", self.go, qos_profile_sensor_data)
        node.create_subscription(Empty, "/arm/stop", self.stop, 10)
        node.create_timer(0.02, self.step)

    def go(self, message):
        self.target_rad = message.position[0]

    def stop(self, _message):
        self.target_rad = self.angle_rad

    def step(self):
        step_rad = 0.02 * SPEED_RAD_S
        self.angle_rad += max(-step_rad, min(step_rad, self.target_rad - self.angle_rad))
        now = self.node.get_clock().now().to_msg()
        message = JointState(name=["trus_roll"], position=[self.angle_rad])
        message.header.stamp = now
        self.measured.publish(message)
        busy = self.angle_rad != self.target_rad
        # Stamped as the angle that belongs to it.
        state = {"state": "ENABLED", "is_homed": True, "is_busy": busy}
        self.state.publish(String(data=json.dumps({**state, "stamp_ns": now.sec * 10**9 + now.nanosec})))


def main():
    rclpy.init()
    node = rclpy.create_node("arm")
    SensorStage(node)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    ends_s = time.monotonic() + 60.0
    while time.monotonic() < ends_s:
        rclpy.spin_once(node)


if __name__ == "__main__":
    main()
