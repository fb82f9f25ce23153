"""Exports of a bank: a sequence for 3D Slicer and PLUS, a file of zea."""

from markerseek.records.exports.sequence import image_to_probe, probe_to_probe_home, write_sequence
from markerseek.records.exports.series import Series, series_of
from markerseek.records.exports.zea import write_zea

__all__ = [
    "Series",
    "image_to_probe",
    "probe_to_probe_home",
    "series_of",
    "write_sequence",
    "write_zea",
]
