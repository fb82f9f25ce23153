"""Which settings of a simulated rig are part of hashes, from which studies draw their seeds."""

from __future__ import annotations

from msgspec import structs

from markerseek.rigs import simulated
from markerseek.sim import LaserSettings, SimulatedSettings
from markerseek.sim.settings import hashable_values

HASHED = {
    "tissue": "plastisol-phantom",
    "start_deg": 0.0,
    "marker": {"angle_deg", "lateral_m", "present", "radius_m", "source_radius_m"},
    "probe": {"array", "element_height_m", "element_width_m", "elevation_focus_m", "face_radius_m"},
    "laser": {"energy_jitter", "pulse_s", "pulses", "rate_hz"},
    "noise": {"bursts", "coloured", "peak_snr_db"},
    "stage": {"acceleration_deg_s2", "approach_deg", "backlash_deg", "counts_per_deg", "settle_s", "speed_deg_s"},
    "receiver": {"peak_counts", "readout_s", "samples", "sampling_hz", "trigger_offset_s"},
    "limits": {"search", "travel"},
}
"""Settings that there were when published tables were made."""


def test_a_setting_that_is_newer_than_published_tables_is_hashed_only_where_it_is_used() -> None:
    """Else all markers of those tables would be others."""
    values = hashable_values(SimulatedSettings())
    assert {name: set(each) if isinstance(each, dict) else each for name, each in values.items()} == HASHED
    used = structs.replace(SimulatedSettings(), laser=LaserSettings(energy_spread=0.1))
    assert set(hashable_values(used)["laser"]) == HASHED["laser"] | {"energy_spread"}
    assert simulated(1, settings=used).facts.fingerprint != simulated(1).facts.fingerprint
