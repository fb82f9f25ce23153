"""Nothing is imported from the folder in which a command is started: no process of ours runs a lab's own files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("serial", reason="needs the extra devices")
pytest.importorskip("h5py", reason="needs the extra records")

BANK = Path(__file__).parents[1] / "data" / "banks" / "bank.hdf5"
NAMES = ("serial", "h5py", "msgspec", "numpy", "socket", "struct", "multiprocessing", "markerseek", "resource")
"""What the processes that we start import; a file of each name lies in the folder."""

SUPERVISOR = """
import os
from markerseek.files import Line
from markerseek.supervisor import Supervisor
far, near = os.openpty()
with Supervisor(lines=[Line(name="laser", path=os.ttyname(near), safe_command=b"DISARM")]) as supervisor:
    assert supervisor.pid
print("done")
"""
BANKS = """
import sys
from pathlib import Path
from markerseek.records.banks import read_bank
read_bank(Path(sys.argv[1]))
print("done")
"""
WORKERS = """
from markerseek.studies.workers import in_order
if __name__ == "__main__":
    assert list(in_order(abs, [-1, -2, -3], workers=2)) == [1, 2, 3]
    print("done")
"""


@pytest.mark.parametrize(
    ("program", "where"),
    [(SUPERVISOR, "folder"), (BANKS, "python path"), (WORKERS, "folder")],
    ids=["supervisor", "banks", "workers"],
)
def test_files_in_the_current_folder_are_not_imported(tmp_path: Path, program: str, where: str) -> None:
    lab = tmp_path / "lab"
    elsewhere = tmp_path / "elsewhere"
    lab.mkdir()
    elsewhere.mkdir()
    for name in NAMES:
        trace = tmp_path / f"imported-{name}"
        (lab / f"{name}.py").write_text(f"open({str(trace)!r}, 'w').close()\nraise ImportError('of the lab')\n")
    (elsewhere / "launch.py").write_text(program)
    # a folder of libraries that the user did ask for still counts
    environment = os.environ | ({"PYTHONPATH": str(elsewhere)} if where == "python path" else {})
    done = subprocess.run(
        [sys.executable, elsewhere / "launch.py", BANK],
        cwd=lab, env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert sorted(path.name for path in tmp_path.glob("imported-*")) == [], done.stderr
    assert done.stdout == "done\n", done.stderr
