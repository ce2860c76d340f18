"""Why a connection fails, in words."""

import os
import re
import socket


def in_words(e: OSError) -> str:
    """Return the system's own reason, without the numbers and calls of asyncio's texts."""
    if isinstance(e, socket.gaierror):
        return e.strerror or "this name is not known"
    number = e.errno
    if number is None and isinstance(e, TimeoutError):  # our own limit's
        return "no answer"
    if number is None and (found := re.search(r"\[Errno (\d+)\]", str(e))):
        number = int(found[1])  # of several addresses that were tried, the first one's
    return str(e) if number is None else os.strerror(number)
