"""The servers' own stands are used here too."""

from __future__ import annotations

import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path += [str(TESTS / "sattrack"), str(TESTS / "sattrack" / "servers" / "alpaca")]
