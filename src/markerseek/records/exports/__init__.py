"""Exports of a bank: a sequence for 3D Slicer and PLUS, an MCAP log for ROS 2, a file of zea, a CSV table."""

from markerseek.records.banks.table import write_intensities
from markerseek.records.exports.mcap_log import write_mcap
from markerseek.records.exports.sequence import image_to_probe, probe_to_probe_home, write_sequence
from markerseek.records.exports.series import Series, series_of
from markerseek.records.exports.zea import write_zea

__all__ = [
    "Series",
    "image_to_probe",
    "probe_to_probe_home",
    "series_of",
    "write_intensities",
    "write_mcap",
    "write_sequence",
    "write_zea",
]
