"""Coverage-guided fuzzing of one decoder by atheris: ``python tests/faults/fuzz.py mat CORPUS -max_total_time=300``.

What it finds is minimised by hand and put into ``tests/faults/corpus``, where `test_hostile_files` reads it for ever.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parent))

with atheris.instrument_imports(include=["markerseek", "zipfile", "csv"]):
    import decoders


def main() -> None:
    """Fuzz the decoder that the first argument names; the others go to libFuzzer."""
    name, whole, read = decoders.UNVETTED[sys.argv.pop(1)]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm"))
    for corpus in (Path(each) for each in sys.argv[1:] if not each.startswith("-")):
        corpus.mkdir(parents=True, exist_ok=True)
        (corpus / "whole").write_bytes(whole())

    def one_input(data: bytes) -> None:
        decoders.outcome(read, folder / name, data)

    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
