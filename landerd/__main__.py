"""`python -m landerd`."""

import sys

from landerd.cli import main

if __name__ == "__main__":  # processes of a campaign import this too
    sys.exit(main())
