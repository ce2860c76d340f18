"""`python -m landerd`."""

import sys

from landerd.cli import main

sys.exit(main())
