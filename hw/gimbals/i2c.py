"""Devices on an I2C bus that may hang, spoken to in a thread beside the event loop.

A device that holds the clock line down, or a loose wire, holds up a call to Linux for the adapter's
time-out, usually a second, and again at each call. In the loop that would be a second without
set-points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from smbus2 import SMBus

from landerd.ports import DeviceLost
from landerd.worker import JobHangs, Worker

DEADLINE_S = 0.2  # for one exchange: shorter than gimbal angles may be old (freshness.gimbal_s)


class Bus(Protocol):
    """The part of an open bus (smbus2.SMBus) that all drivers use; each adds what it needs."""

    def close(self) -> None: ...  # noqa: D102


B = TypeVar("B", bound=Bus)
B_co = TypeVar("B_co", bound=Bus, covariant=True)
T = TypeVar("T")


@dataclass(frozen=True)
class I2c(Generic[B_co]):
    """How a bus is reached."""

    open_bus: Callable[[int], B_co]  # by its number. Raises OSError
    in_thread: bool  # its calls may hang; else they are made in the loop, as on a virtual clock


KERNELS = I2c(SMBus, in_thread=True)


class I2cDevice(Generic[B]):
    """One device on a bus. A call that hangs is given up; until it returns the bus stays closed."""

    def __init__(self, name: str, number: int, i2c: I2c[B]) -> None:
        """Make it, not open. Name: for the pilot; number: of the bus."""
        self._name, self._number = f"{name} of /dev/i2c-{number}", number
        self._open_bus = i2c.open_bus
        self._worker = Worker("i2c") if i2c.in_thread else None
        self._session: _Session[B] | None = None
        self._given_up: _Session[B] | None = None

    async def open(self, set_up: Callable[[B], None]) -> None:
        """Open the bus and set the device up. Raises DeviceLost."""
        await self.close()
        if self._given_up is not None and self._given_up.is_busy:
            raise DeviceLost(f"{self._name}: the bus still hangs")
        self._session = _Session(self._number, self._open_bus)
        try:
            await self.do(set_up)
        except DeviceLost:
            await self.close()
            raise

    async def do(self, exchange: Callable[[B], T]) -> T:
        """Return what an exchange on the open bus returns.

        Raises:
            DeviceLost: it failed, or took longer than DEADLINE_S.
        """
        session = self._session
        if session is None:
            raise DeviceLost(f"{self._name}: closed")
        session.is_busy = True
        try:
            if self._worker is None:
                return session.do(exchange)
            return await self._worker.run(lambda: session.do(exchange), DEADLINE_S)
        except OSError as e:
            raise DeviceLost(f"{self._name}: {e.strerror or e}") from None
        except JobHangs:
            self._session, self._given_up = None, session
            session.give_up()
            raise DeviceLost(f"{self._name}: no answer for {DEADLINE_S:g} s") from None

    async def close(self) -> None:
        """Let go of the bus; safe to call twice. An exchange that is under way ends first."""
        session, self._session = self._session, None
        if session is not None:
            session.give_up()
        if self._worker is not None:
            self._worker.close()


class _Session(Generic[B]):
    """An open bus, touched by the thread alone for as long as an exchange is under way.

    Attributes:
        is_busy: it is; set by who asks for it.
    """

    def __init__(self, number: int, open_bus: Callable[[int], B]) -> None:
        self._number, self._open_bus = number, open_bus
        self._bus: B | None = None
        self._is_over = False
        self.is_busy = False

    def do(self, exchange: Callable[[B], T]) -> T:
        """Open the bus if it is not, and do something on it. Raises OSError."""
        try:
            if self._is_over:
                raise OSError("given up before its turn came")
            if self._bus is None:
                self._bus = self._open_bus(self._number)
            return exchange(self._bus)
        finally:
            self.is_busy = False
            if self._is_over:
                self._close()

    def give_up(self) -> None:
        """Close the bus, now or when the exchange under way has come back."""
        self._is_over = True
        if not self.is_busy:
            self._close()

    def _close(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()
