"""Makes the suite's Python package pi_speech importable from this folder, built or not: import this module first."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "src"))
