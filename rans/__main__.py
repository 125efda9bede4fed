"""``python -m rans`` is ``rans``."""

from __future__ import annotations

import sys

from rans_command import main

sys.exit(main())
