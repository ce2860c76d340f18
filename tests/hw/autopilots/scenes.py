"""What the tests of the driver share: it and the stand-in, joined, in virtual time."""

from collections.abc import Awaitable, Callable

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from landerd.runtime.clock import run_virtual
from tests.hw.flight import Flight

GUIDED, LOITER = 4, 5


def fly(scene: Callable[[Flight], Awaitable[None]], flight: Callable[[], Flight] = Flight) -> None:
    async def main() -> None:
        async with flight() as f:
            await f.connect()
            await scene(f)

    run_virtual(main())


def sent(f: Flight) -> list[Message]:
    """Start to collect what the driver writes; messages appear in the list as they go out."""
    messages: list[Message] = []
    codec = MavlinkCodec(255, 190)
    f.driver_link.tap = lambda t, data: messages.extend(codec.decode(data))
    return messages
