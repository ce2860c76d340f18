"""Checks whether the status page and Foxglove's data will be served, and to whom."""

import errno

from landerd.config.models import WebSection
from landerd.preflight.finding import Finding
from landerd.web.door import Door, DoorError, door_of
from landerd.web.foxglove_server import foxglove_door


def page_findings(section: WebSection) -> list[Finding]:
    """Return whether the page can be served, if configured; it is never fatal to a landing."""
    item = "status page"
    try:
        door = door_of(section)
    except DoorError as e:
        mend = "write a token into a file and name it in web.token_file (docs/status-page.md)"
        return [Finding("warn", item, f"there will be none: {e}", mend)]
    if door is None:
        return []
    who = "on this computer" if door.token is None else "for who has the token"
    return [_served(item, door, "web.listen", f"{door.url}, {who}")]


def foxglove_findings(section: WebSection) -> list[Finding]:
    """Return whether Foxglove's data can be served, if configured."""
    item = "foxglove"
    try:
        door = foxglove_door(section)
    except DoorError as e:
        mend = "do that, or set web.foxglove to null (docs/status-page.md)"
        return [Finding("warn", item, f"there will be nothing: {e}", mend)]
    if door is None:
        return []
    return [_served(item, door, "web.foxglove", f"ws://{door.address}, on this computer")]


def _served(item: str, door: Door, key: str, what: str) -> Finding:
    try:
        door.bound().close()
    except (OSError, UnicodeError) as e:
        return Finding("warn", item, *_unbound(door, key, e))
    return Finding("ok", item, what)


def _unbound(door: Door, key: str, error: OSError | UnicodeError) -> tuple[str, str]:
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EADDRINUSE:
        what = f"port {door.port} is in use: by the landerd service, if that runs now"
        return what, f"otherwise set another port in {key}"
    if number == errno.EACCES:
        what = f"this user may not serve on port {door.port}"
        return what, f"set a port above 1023 in {key}, as 8080"
    what = f"this computer has no address {door.host} now: it is served when it has"
    return what, f"set an address of this computer in {key} (ip addr)"
