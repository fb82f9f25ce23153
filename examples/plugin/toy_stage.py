from markerseek.core import NotConnectedError
from markerseek.drivers import StageStatus


class Stage:
    """A stage that answers ID?, POS?, BUSY?, SPEED and MOVE by a line of text each, and STOP by nothing."""

    safe_command = b"STOP\n"  # what the supervisor sends to its port when the search dies
    resolution_deg = 0.01  # how well its readback repeats

    def __init__(self, *, line, clock, zero_deg: float, speed_deg_s: float = 20.0):
        self._line = line
        self._clock = clock
        self._zero_deg = zero_deg
        self.speed_deg_s = speed_deg_s
        self.description = self._ask("ID?")
        if not self.description.startswith("TOY"):
            raise NotConnectedError(f"{self.description!r} is at the stage's port, not a TOY stage; correct stage.port")
        self.emulated = self.description.endswith("pretended")
        self._ask(f"SPEED {speed_deg_s:g}")

    def read(self):
        return StageStatus(angle_deg=float(self._ask("POS?")) - self._zero_deg, moving=self._ask("BUSY?") != "0")

    def go(self, angle_deg):
        self._ask(f"MOVE {angle_deg + self._zero_deg:.4f}")

    def stop(self):
        self._line.write(self.safe_command)

    def _ask(self, command):
        self._line.read(4096, timeout_s=0.0)  # what waits here answers an earlier question
        self._line.write(command.encode() + b"\n")
        answer = b""
        ends_s = self._clock.now_s() + 2.0
        while not answer.endswith(b"\n"):
            if self._clock.now_s() > ends_s:
                raise NotConnectedError(f"the stage does not answer {command}; check its cable and its power")
            answer += self._line.read(1, timeout_s=0.02)
        return answer.decode().strip()
