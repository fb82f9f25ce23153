from markerseek.core import LaserError


class Laser:
    """A trigger box that takes FIRE lit dark, and answers COUNT? by the lit pulses so far, or by BUSY."""

    safe_command = b"OFF\n"  # what the supervisor sends to its port when the search dies: its light goes out

    def __init__(self, *, line, clock, pulses: int, rate_hz: float):
        self._line = line
        self._clock = clock
        self._pulses = pulses
        self._ask(f"RATE {rate_hz:g}")

    def fire(self, pulses):
        dark = 0 if pulses else self._pulses  # a dark acquisition: as many triggers for the receiver, and no light
        self._ask(f"FIRE {pulses} {dark}")

    def fired(self):
        answer = self._ask("COUNT?")
        return None if answer == "BUSY" else int(answer)

    def off(self):
        if self._ask("OFF") != "OK":
            raise LaserError("the laser does not confirm that it is off; cut its power")

    def _ask(self, command):
        self._line.read(4096, timeout_s=0.0)  # what waits here answers an earlier command
        self._line.write(command.encode() + b"\n")
        answer = b""
        ends_s = self._clock.now_s() + 0.5
        while not answer.endswith(b"\n"):
            if self._clock.now_s() > ends_s:
                raise LaserError(f"the laser does not answer {command}; check its cable and its power")
            answer += self._line.read(1, timeout_s=0.02)
        return answer.decode().strip()
