"""`python -m worker.cli`: the `groundplan` command without its installed script."""

import sys

from worker.cli import main

sys.exit(main())
