"""A console in plain rclpy, as a lab would write it: it commands a stage or an acquisition, and prints what it hears.

``console.py RELIABILITY ACTION [WORD ...]``: ``stop TOPIC`` moves to 30 degrees and stops 0.3 s later;
``acquire PULSES ...`` asks for acquisitions, one after the other.
"""

import json
import math
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, String


class Console:
    def __init__(self, reliability):
        self.node = rclpy.create_node("console")
        self.quality = QoSProfile(depth=10, reliability=ReliabilityPolicy[reliability])

    def publisher(self, kind, topic):
        made = self.node.create_publisher(kind, topic, self.quality)
        # That of a node which cannot hear it is not counted.
        ends_s = time.monotonic() + 5.0
        while made.get_subscription_count() == 0 and time.monotonic() < ends_s:
            self.wait(0.01)
        # The other side may find this one later, and what is best effort is lost until then.
        self.wait(1.0)
        return made

    def wait(self, duration_s):
        ends_s = time.monotonic() + duration_s
        while (left_s := ends_s - time.monotonic()) > 0:
            rclpy.spin_once(self.node, timeout_sec=left_s)

    def stop(self, topic):
        angles_deg = []
        take = lambda message: angles_deg.append(math.degrees(message.position[0]))  # noqa: E731
        self.node.create_subscription(JointState, "/TRUS/measured_js", take, 10)
        move = self.publisher(JointState, "/TRUS/move_jp")
        stop = self.publisher(Empty, topic)
        while not angles_deg:
            self.wait(0.01)
        message = JointState(name=["trus_roll"], position=[math.radians(30.0)])
        message.header.stamp = self.node.get_clock().now().to_msg()
        move.publish(message)
        self.wait(0.3)
        stop.publish(Empty())
        self.wait(1.0)
        return {"rest_deg": angles_deg[-1]}

    def acquire(self, *pulses):
        heard = []
        self.node.create_subscription(String, "/TRUS/pa/acquired", lambda message: heard.append(message.data), 10)
        request = self.publisher(String, "/TRUS/pa/acquire")
        for index, each in enumerate(pulses):
            asked = {"id": str(index), "pulses": int(each), "angle_rad": 0.0, "stamp_ns": time.time_ns()}
            request.publish(String(data=json.dumps(asked)))
            ends_s = time.monotonic() + 10.0
            while len(heard) < 2 * (index + 1) and time.monotonic() < ends_s:
                self.wait(0.01)
        # What a second copy of a request would be answered with.
        self.wait(0.5)
        answers = map(json.loads, heard)
        return {"answers": [[each["id"], each["step"], each["error"]] for each in answers]}


def main():
    rclpy.init()
    reliability, action, *words = sys.argv[1:]
    said = getattr(Console(reliability), action)(*words)
    sys.stdout.write(json.dumps(said) + "\n")


if __name__ == "__main__":
    main()
