"""Coverage-guided fuzzing of one decoder by atheris: ``python -m tests.faults.fuzz mat CORPUS -max_total_time=300``.

Its findings are minimised by hand and put into ``tests/faults/corpus``, where `test_hostile_files` and
`test_hostile_devices` read them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["markerseek", "zipfile", "csv"]):
    from tests.faults import decoders, wire_decoders

_FILES = decoders.IN_THIS_PROCESS


def _target(name: str) -> tuple[Callable[[], bytes], Callable[[bytes], object]]:
    """A valid file or all bytes of a correct device, and the function that reads them."""
    if name in wire_decoders.WIRES:
        whole, decode = wire_decoders.WIRES[name]
        return whole, lambda data: wire_decoders.wire_outcome(decode, data)
    file_name, whole, read = _FILES[name]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm"))
    return whole, lambda data: decoders.outcome(read, folder / file_name, data)


def main() -> None:
    """Fuzz the decoder that the first argument names; the others go to libFuzzer."""
    names = (*wire_decoders.WIRES, *_FILES)
    if len(sys.argv) < 2 or sys.argv[1] not in names:
        sys.exit(f"say first which decoder to fuzz: {', '.join(names)}")
    whole, one_input = _target(sys.argv.pop(1))
    for corpus in (Path(each) for each in sys.argv[1:] if not each.startswith("-")):
        corpus.mkdir(parents=True, exist_ok=True)
        (corpus / "whole").write_bytes(whole())
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
