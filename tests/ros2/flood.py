"""Floods a stage node with commands that it must not carry out, some thousand a second."""

import math
import sys
import time

import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import String


def main():
    rclpy.init()
    node = rclpy.create_node("flood")
    joints = node.create_publisher(JointState, "/TRUS/move_jp", 10)
    texts = node.create_publisher(String, "/TRUS/pa/acquire", 10)
    while joints.get_subscription_count() == 0:
        time.sleep(0.01)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    bad = [
        JointState(name=["trus_roll"], position=[0.3]),
        JointState(name=["trus_roll"], position=[math.nan]),
        JointState(name=["x"] * 1000, position=[9.0] * 1000),
    ]
    while True:
        for message in bad:
            joints.publish(message)
        texts.publish(String(data="{" * 1000))
        time.sleep(0.002)


if __name__ == "__main__":
    main()
