"""``python -m froxel_ref`` does what ``froxel-ref`` does, and needs no PATH."""

from __future__ import annotations

import sys

from froxel_ref.cli import main

if __name__ == "__main__":
    sys.exit(main())
