"""The screens of a run, by the keys that show them."""

from __future__ import annotations

LIVE, TONIGHT, MOUNT, SCHEDULE, LOG = "live", "tonight", "mount", "schedule", "log"
PAGES = {"1": LIVE, "2": TONIGHT, "3": MOUNT, "4": SCHEDULE, "5": LOG}
PAGE_CLASSES = {page: f"-page-{page}" for page in PAGES.values()}
