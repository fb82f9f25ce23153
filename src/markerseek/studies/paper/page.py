"""The frame of the report: what every page has, with places for what `report` puts in."""

from __future__ import annotations

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>The paper, reproduced</title>
<style>
body {{ font: 15px/1.55 system-ui, sans-serif; color: #1c2026; margin: 2rem auto; max-width: 1160px; padding: 0 1rem; }}
h1 {{ font-size: 1.5rem; }}
h2 {{ font-size: 1.2rem; margin-top: 3rem; border-top: 2px solid #1f5fa8; padding-top: 1rem; }}
h3 {{ font-size: 1rem; margin: 1.4rem 0 .4rem; }}
p, li {{ max-width: 62rem; }}
p.note {{ color: #7a3410; font-weight: 600; }}
img {{ max-width: 100%; border: 1px solid #e3e6ea; }}
.wide {{ overflow-x: auto; margin-top: 1.2rem; }}
table {{ border-collapse: collapse; font-size: 13px; }}
th, td {{ text-align: left; vertical-align: top; padding: .2rem .9rem .2rem 0; border-bottom: 1px solid #e3e6ea; }}
th {{ color: #4a505a; }} td {{ font-variant-numeric: tabular-nums; }}
td.n {{ text-align: right; white-space: nowrap; }} td.s {{ white-space: nowrap; }} th {{ vertical-align: bottom; }}
th.n {{ text-align: right; }}
caption {{ text-align: left; font-weight: 600; padding: .3rem 0; }}
nav a {{ margin-right: 1rem; }} .files {{ color: #6a707a; font-size: 13px; }}
</style>
</head>
<body>
<h1>The paper, reproduced</h1>
<p>Wu, Moradi, Yang, Song, Boctor, Salcudean: Automatic Search for Photoacoustic Marker Using Automated Transrectal
Ultrasound. The paper's numbers beside ours.</p>
<p class="note">Simulated: no hardware was involved, and the materials are stand-ins. {note}</p>
<p>markerseek {version}, seed {seed}, {markers} markers. Intervals are of 95 %, of the mean. "Off" is the share of
searches with an error above 4.33°, half of the range in which the tool tip stays visible.</p>
<nav>{contents}</nav>
{sections}
<h2 id="fig9">Fig. 9: sensitive range of the tool tip</h2>
<p>{fig9}</p>
<h2 id="limits">Every number of the paper that cannot be had, and why</h2>
<ul>{limits}</ul>
</body>
</html>
"""
