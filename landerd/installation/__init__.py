"""Puts landerd on a computer as a service, and takes it away again.

Needs nothing but Python itself, so that it runs from a checkout or out of a wheel file before
anything is installed; only `keys` reads configurations, and is imported where there is something
to read them with.
"""
