"""The interface of those who watch the daemon: flight log, status page, simulator."""

from typing import Protocol

from landerd.lander import Lander
from landerd.messages import Command, Frame, Input, Prior, Sightings


class Observer(Protocol):
    """Sees all that happens and changes nothing: the flight log, a progress line.

    Whoever derives from it writes only the methods that it has a use for; the others do nothing
    (they return: to mypy a protocol's empty methods would be abstract).
    """

    def on_flight(self, lander: Lander) -> None:
        """A flight begins, with a core that knows of no other."""
        return

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """A frame was searched."""
        return

    def on_vision_reset(self) -> None:
        """Vision begins anew: a search failed, or hung."""
        return

    def on_last_orders(self, now: float) -> None:
        """The core has failed; one of the orders that it had prepared goes out at time now, s."""
        return

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """The core took a message and gave commands."""
        return
