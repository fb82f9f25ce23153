"""An entry to ``markerseek benchmark`` in plain Python: steps of 5°, then a parabola through the top of the curve."""


class Steps:
    """It is made for each search: ``ask`` for an angle until None, be told each sample, then ``answer``."""

    def __init__(self, search):
        low, high = search["low_deg"], search["high_deg"]
        self.angles = [low + step * (high - low) / 14 for step in range(15)]
        self.noise = max((sample["intensity"] for sample in search["dark"]), default=0)
        self.samples = []

    def ask(self):
        """Next angle in degrees, or None."""
        return self.angles[len(self.samples)] if len(self.samples) < 15 else None

    def tell(self, sample):
        """Take one sample."""
        self.samples.append(sample["intensity"])

    def answer(self):
        """Answer, once nothing more is asked for."""
        top = max(range(1, 14), key=lambda index: self.samples[index])
        left, peak, right = self.samples[top - 1 : top + 2]
        if peak < 2 * self.noise or left + right >= 2 * peak:
            return {"answer": "not found"}
        shift = (left - right) / (left + right - 2 * peak) / 2
        found = self.angles[top] + min(1, max(-1, shift)) * 5
        return {"answer": "found", "angle_deg": found, "low_deg": found - 1.5, "high_deg": found + 1.5}
