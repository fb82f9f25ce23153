"""Find a marker on the simulated rig: the loop in full, then another method by `run`."""

import markerseek

rig = markerseek.simulated(seed=1)

# The caller owns the loop.
policy = markerseek.build("golden-section", limits=rig.limits.search)
for _ in range(rig.dark_frames):
    policy.tell(rig.scanner.measure_dark())
while (angle_deg := policy.ask()) is not None:
    policy.tell(rig.scanner.measure(angle_deg))
print(policy.estimate())

# `run` has this loop, moves to the marker, confirms, and leaves the rig stopped whatever happens.
policy = markerseek.build(
    markerseek.SearchPlan(method="weighted-average", start_deg=rig.stage.angle_deg), limits=rig.limits.search
)
for event in markerseek.run(policy, rig.scanner, rig.run_plan):
    if isinstance(event, markerseek.Finished):
        print(event.estimate)
print(f"truth: {rig.facts.truth_deg:.3f} deg (simulated)")
