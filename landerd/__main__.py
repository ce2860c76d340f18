"""`python -m landerd`, and `python landerd-VERSION.whl/landerd`, out of the wheel file itself."""

import os
import sys

if not __package__:  # sys.path begins with this folder instead of the one that it is in
    sys.path[0] = os.path.dirname(sys.path[0])

from landerd.cli import entry_point

if __name__ == "__main__":  # processes of a campaign import this too
    entry_point()
