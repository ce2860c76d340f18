"""The status page: what landerd sees and does, on a phone, or in Foxglove; it decides nothing."""

from landerd.web.foxglove_server import FoxgloveServer
from landerd.web.status_page import StatusPage

__all__ = ["FoxgloveServer", "StatusPage"]
