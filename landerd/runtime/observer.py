"""The interface of what watches the daemon: flight log, status page, simulator."""

from typing import Protocol

from landerd.lander import Lander
from landerd.messages import Command, Frame, Input, Prior, Sightings


class Observer(Protocol):
    """Is told of everything that happens and changes nothing, as the flight log.

    A derived class overrides the methods that it needs; the others do nothing. (They return, since
    to mypy a protocol's empty methods would be abstract.)
    """

    def on_flight(self, lander: Lander) -> None:
        """A flight begins, with a new core."""
        return

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """A frame was searched."""
        return

    def on_vision_reset(self) -> None:
        """Vision was replaced by a new one: a search failed, or hung."""
        return

    def on_last_orders(self, now: float) -> None:
        """One of the orders prepared before the core failed is sent at time now, s."""
        return

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """The core took a message and gave commands."""
        return
