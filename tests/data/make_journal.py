"""Makes a journal of the present version, to be kept as a fixture: python tests/data/make_journal.py FILE."""

from __future__ import annotations

import sys
from pathlib import Path

from markerseek import rigs
from markerseek.records.journal import Journal
from markerseek.runs.journalled import configuration_of, journalled
from markerseek.search import build
from markerseek.sim import GaussianCurve

SEED, MARKER_DEG, ACQUISITIONS = 11, -12.375, 10

rig = rigs.of_intensities(seed=SEED, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=MARKER_DEG)
start_deg = rig.stage.angle_deg
policy = build("golden-section", limits=rig.limits.search, acquisitions=ACQUISITIONS, as_published=True)
configuration = configuration_of(
    rig,
    method="golden-section",
    acquisitions=ACQUISITIONS,
    as_published=True,
    start_deg=start_deg,
    dark_frames=0,
    stay=False,
    seed=SEED,
)
with Journal.create(Path(sys.argv[1]), configuration) as journal:
    for _ in journalled(policy, rig, journal):
        pass
