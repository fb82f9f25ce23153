"""A client by other people's crtk_python_client: it moves a stage node, holds it, and prints what it was told."""

import json
import math
import sys
import time

import crtk


class Client:
    def __init__(self, ral):
        utils = crtk.utils(self, ral, connection_timeout=2.0)
        utils.add_operating_state()
        utils.add_measured_js()
        utils.add_measured_cp()
        utils.add_setpoint_js()
        utils.add_move_jp()
        utils.add_servo_jp()
        utils.add_hold()


def angle_deg(client):
    return math.degrees(client.measured_jp()[0][0])


def main():
    ral = crtk.ral("crtk_client", "TRUS")
    client = Client(ral)
    ral.spin()
    ral.check_connections(20.0)
    client.setpoint_jp(wait_timeout=10.0)
    said = {"enabled": client.enable(5.0), "homed": client.home(5.0)}
    client.measured_jp(wait_timeout=10.0)
    target_rad = math.radians(angle_deg(client) + 3.0)
    said["moved"] = client.move_jp(client.setpoint_jp()[0] * 0 + target_rad).wait(timeout=20.0)
    # Angle and state are on two topics, which are not in step.
    time.sleep(1.0)
    said["off_deg"] = angle_deg(client) - math.degrees(target_rad)
    frame = client.measured_cp()[0]
    said["pose_deg"] = math.degrees(frame.M.GetRPY()[1]) - angle_deg(client)
    client.move_jp(client.setpoint_jp()[0] * 0 + target_rad - math.copysign(0.5, target_rad))
    while abs(angle_deg(client) - math.degrees(target_rad)) < 2.0:
        time.sleep(0.02)
    client.hold()
    time.sleep(1.0)
    held_deg = angle_deg(client)
    time.sleep(0.5)
    said["drift_deg"] = angle_deg(client) - held_deg
    said["from_setpoint_deg"] = math.degrees(client.setpoint_jp()[0][0]) - held_deg
    started_s = time.monotonic()
    said["disabled"] = client.disable(5.0)
    said["disabled_s"] = time.monotonic() - started_s
    said["enabled_again"] = client.enable(1.0)
    sys.stdout.write(json.dumps(said) + "\n")
    ral.shutdown()


if __name__ == "__main__":
    main()
