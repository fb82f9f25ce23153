"""Coverage-guided fuzzing of one decoder by atheris: ``python -m tests.faults.fuzz igtl CORPUS -max_total_time=300``.

Its findings are minimised by hand and put into ``tests/faults/corpus``, where `test_hostile_devices` reads them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["markerseek"]):
    from tests.faults.wire_decoders import WIRES, wire_outcome


def main() -> None:
    """Fuzz the decoder that the first argument names; the others go to libFuzzer."""
    if len(sys.argv) < 2 or sys.argv[1] not in WIRES:
        sys.exit(f"say first which decoder to fuzz: {', '.join(WIRES)}")
    whole, decode = WIRES[sys.argv.pop(1)]
    for corpus in (Path(each) for each in sys.argv[1:] if not each.startswith("-")):
        corpus.mkdir(parents=True, exist_ok=True)
        (corpus / "whole").write_bytes(whole())
    atheris.Setup(sys.argv, lambda data: wire_outcome(decode, data))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
