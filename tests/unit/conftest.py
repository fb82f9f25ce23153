"""What several files of tests share lies in modules beside them, such as `scan_bench`, imported by name."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
