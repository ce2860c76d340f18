"""The status page: what landerd sees and does, on a phone; it decides nothing."""

from landerd.web.status_page import StatusPage

__all__ = ["StatusPage"]
