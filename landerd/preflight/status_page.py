"""The status page: whether it will be served, and to whom."""

import errno

from landerd.config.models import WebSection
from landerd.preflight.finding import Finding
from landerd.web.door import Door, DoorError, door_of

_ITEM = "status page"


def page_findings(section: WebSection) -> list[Finding]:
    """Return whether the page can be served; nothing if none is asked for. It stops no landing."""
    try:
        door = door_of(section)
    except DoorError as e:
        mend = "write a token into a file and name it in web.token_file (docs/status-page.md)"
        return [Finding("warn", _ITEM, f"there will be none: {e}", mend)]
    if door is None:
        return []
    try:
        door.bound().close()
    except (OSError, UnicodeError) as e:
        return [_unbound(door, e)]
    who = "on this computer" if door.token is None else "for who has the token"
    return [Finding("ok", _ITEM, f"{door.url}, {who}")]


def _unbound(door: Door, error: OSError | UnicodeError) -> Finding:
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EADDRINUSE:
        what = f"port {door.port} is in use: by the landerd service, if that runs now"
        return Finding("warn", _ITEM, what, "otherwise set another port in web.listen")
    if number == errno.EACCES:
        what = f"this user may not serve on port {door.port}"
        return Finding("warn", _ITEM, what, "set a port above 1023 in web.listen, as 8080")
    what = f"this computer has no address {door.host} now: the page comes when it has"
    return Finding("warn", _ITEM, what, "set an address of this computer in web.listen (ip addr)")
