"""Texts for the user on why a connection failed."""

import os
import re
import socket


def in_words(e: OSError) -> str:
    """Return the operating system's reason, without the error numbers of asyncio's texts."""
    if isinstance(e, socket.gaierror):
        return e.strerror or "this name is not known"
    number = e.errno
    if number is None and isinstance(e, TimeoutError):  # by our own time limit
        return "no answer"
    if number is None and (found := re.search(r"\[Errno (\d+)\]", str(e))):
        number = int(found[1])  # if several addresses were tried, that of the first
    return str(e) if number is None else os.strerror(number)
