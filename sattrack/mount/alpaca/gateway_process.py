"""The process of an Alpaca telescope's gateway: what it reads is dated, so it goes before other programs."""

from __future__ import annotations

import sys

from sattrack.core.realtime import go_before_others
from sattrack.mount.alpaca import gateway

if __name__ == "__main__":
    go_before_others()
    sys.exit(gateway.main())
