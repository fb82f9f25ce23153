"""A stage node of plain std_msgs, as a LabVIEW bridge would be: degrees in on /goto, degrees out on /angle."""

import sys

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64

COUNTS_PER_DEG = 1919.6418578623391  # a real stage stops at whole counts of its encoder


class NumberStage:
    def __init__(self, node, turn=lambda _angle_deg: None, start_deg=0.0):
        self.angle_deg = round(start_deg * COUNTS_PER_DEG) / COUNTS_PER_DEG
        self.moves = 0
        self._turn = turn
        self._reached = node.create_publisher(Float64, "/angle", 10)
        node.create_subscription(Float64, "/goto", self.go, 10)
        node.create_timer(0.1, self.tell)

    def go(self, message):
        self.angle_deg = round(message.data * COUNTS_PER_DEG) / COUNTS_PER_DEG
        self.moves += 1
        self._turn(message.data)
        self.tell()

    def tell(self):
        self._reached.publish(Float64(data=self.angle_deg))


def main():
    rclpy.init(signal_handler_options=SignalHandlerOptions.ALL)
    node = rclpy.create_node("labview_bridge")
    stage = NumberStage(node)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        sys.stderr.write(f"{stage.moves} moves\n")


if __name__ == "__main__":
    main()
