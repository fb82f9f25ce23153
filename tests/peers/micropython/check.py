"""Run by MicroPython after the firmware's own text, which has `Box`; RUNS is what runs.py wrote."""
# ruff: noqa: B905, F821, T201 - the firmware precedes this, and its zip knows no strict

import json
import sys


def differences(run):
    found = []
    now_ms = [0]
    closed = [True]
    pulses_ms = []
    box = Box(lambda laser: pulses_ms.append(now_ms[0]) if laser else None, lambda: len(pulses_ms), lambda: closed[0])
    for (kind, value), expected in zip(run["steps"], run["said"]):
        said = b""
        if kind == "feed":
            said = box.feed(bytes.fromhex(value))
        elif kind == "ms":
            for _ in range(value):
                now_ms[0] += 1
                said += box.advance(1000 * now_ms[0])
        elif kind == "flick":
            box.interlock_opened = True
        elif kind == "light":
            pulses_ms.append(now_ms[0])
        else:
            closed[0] = value
            box.interlock_opened = box.interlock_opened or not value
            said = box.advance(1000 * now_ms[0])
        if said != bytes.fromhex(expected):
            found.append((kind, value, said, expected))
    if pulses_ms != run["pulses_ms"]:
        found.append(("pulses", pulses_ms, run["pulses_ms"]))
    return found


IDENTITY = "emulator"
runs = json.loads(RUNS)
found = [difference for run in runs for difference in differences(run)]
pulses = sum(len(run["pulses_ms"]) for run in runs)
print(sys.implementation.version, len(runs), "runs,", pulses, "pulses,", len(found), "differences", found[:3])
