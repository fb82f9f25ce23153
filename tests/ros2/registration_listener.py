"""A listener in plain rclpy of default settings, as a lab would write it; prints each message as a line of JSON."""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String


def say(**what):
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def transform(topic):
    def take(message):
        place = message.transform.translation
        turned = message.transform.rotation
        say(
            topic=topic,
            frames=[message.header.frame_id, message.child_frame_id],
            place_m=[place.x, place.y, place.z],
            quaternion=[turned.x, turned.y, turned.z, turned.w],
            stamp_s=message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec,
            age_s=time.time() - message.header.stamp.sec - 1e-9 * message.header.stamp.nanosec,
        )

    return take


def main():
    rclpy.init()
    node = rclpy.create_node("listener")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(TransformStamped, "/pa_search/registration", transform("registration"), latched)
    node.create_subscription(TransformStamped, "/tf_static", transform("static"), latched)
    node.create_subscription(TransformStamped, "/tf", transform("tf"), 100)
    node.create_subscription(
        String,
        "/pa_search/registration_state",
        lambda message: say(topic="state", **json.loads(message.data)),
        latched,
    )
    node.create_subscription(
        String, "/pa_follow/state", lambda message: say(topic="follow", **json.loads(message.data)), latched
    )
    say(topic="ready")
    rclpy.spin(node)


if __name__ == "__main__":
    main()
