"""A lab's camera node: two topics of images, as ROS 2 drivers publish them.

``image_publisher.py LEFT RIGHT ENCODING RELIABILITY COLUMNS OFFSET_S``: 30 pairs a second. Pair n is even, of
brightness n; the right image is sent first, and stamped OFFSET_S later.
"""

import array
import sys
import time

import cv2
import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image

CHANNELS = {"mono8": 1, "mono16": 2, "bayer_rggb8": 1, "rgb8": 3, "bgra8": 4, "jpeg": 3}


def message(encoding: str, value: int, columns: int, stamp_s: float):
    channels = CHANNELS[encoding]
    image = np.full((128, columns, channels), value, np.uint8)
    image[..., 1:3] //= 2
    if channels == 4:
        image[..., 3] = 255
    if encoding == "jpeg":
        made = CompressedImage(format="jpeg", data=array.array("B", cv2.imencode(".jpg", image[..., :1])[1].tobytes()))
    else:
        # Rows end with bytes that are no pixels, as drivers with aligned memory have them.
        padded = np.full((128, columns * channels + 32), 99, np.uint8)
        padded[:, : columns * channels] = image.reshape(128, -1)
        made = Image(height=128, width=columns, encoding=encoding, step=padded.shape[1])
        made.data = array.array("B", padded.tobytes())
    made.header.stamp.sec = int(stamp_s)
    made.header.stamp.nanosec = int(stamp_s % 1 * 1e9)
    return made


def main(left: str, right: str, encoding: str, reliability: str, columns: str, offset_s: str) -> None:
    rclpy.init()
    node = rclpy.create_node("endoscope")
    quality = QoSProfile(depth=5, reliability=ReliabilityPolicy[reliability])
    kind = CompressedImage if encoding == "jpeg" else Image
    publishers = [node.create_publisher(kind, topic, quality) for topic in (right, left)]
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for number in range(10**6):
        now_s = time.time()
        for publisher, later_s in zip(publishers, (float(offset_s), 0.0), strict=True):
            publisher.publish(message(encoding, number % 200 + 20, int(columns), now_s + later_s))
        # The frame rate of a camera.
        time.sleep(1 / 30)


if __name__ == "__main__":
    main(*sys.argv[1:])
