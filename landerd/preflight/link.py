"""Remedies for a broken link to the autopilot, by the kind that `autopilot.url` names."""

_SENDS = "is it MAVLink that is sent there? SERIALn_PROTOCOL or NET_Pn_PROTOCOL 2; the right port?"

SILENT = {
    "serial": "SERIALn_PROTOCOL 2, TX and RX crossed, the right port and baud",
    "udpin": "it, or what forwards it, must send to this port of this computer; a firewall?",
    "udpout": "it, or what forwards it, must listen at this address and port; a firewall?",
    "tcp": "SERIALn_PROTOCOL or NET_Pn_PROTOCOL 2, the right port",
    "tcpin": "it, or what forwards it, must call this port of this computer; a firewall?",
}
GARBLED = {
    "serial": "make the baud rate of autopilot.url that of SERIALn_BAUD; SERIALn_PROTOCOL 2",
    **dict.fromkeys(("udpin", "udpout", "tcp", "tcpin"), _SENDS),
}
NO_LINK = {
    "serial": "check autopilot.url, the cable, and group dialout",
    "udpin": "check address and port of autopilot.url; does another program listen there?",
    "udpout": "check address and port of autopilot.url, and the network",
    "tcp": "check address and port of autopilot.url; does anything listen there?",
    "tcpin": "check address and port of autopilot.url; does another program listen there?",
}


def link_kind(url: str) -> str:
    """Return the kind of link that a URL names; an unknown kind counts as a cable."""
    kind = url.partition(":")[0]
    return kind if kind in SILENT else "serial"
