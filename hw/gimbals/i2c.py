"""Devices on an I2C bus that may hang: they are read and written in a thread.

A device that holds the clock line down, or a loose wire, blocks each call to Linux for the
adapter's time-out, usually a second. In the event loop that would be a second without set-points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from smbus2 import SMBus

from landerd.ports import DeviceLost
from landerd.worker import JobHangs, Worker

DEADLINE_S = 0.2  # limit of one exchange, below the age limit of angles (freshness.gimbal_s)


class Bus(Protocol):
    """The part of an open bus (smbus2.SMBus) that all drivers use; each adds its own calls."""

    def close(self) -> None: ...  # noqa: D102


B = TypeVar("B", bound=Bus)
B_co = TypeVar("B_co", bound=Bus, covariant=True)
T = TypeVar("T")


@dataclass(frozen=True)
class I2c(Generic[B_co]):
    """How a bus is opened, and where its calls are made."""

    open_bus: Callable[[int], B_co]  # by its number. Raises OSError
    in_thread: bool  # calls are made in a thread, as they may hang; else in the event loop


KERNELS = I2c(SMBus, in_thread=True)


class I2cDevice(Generic[B]):
    """One device on a bus. A hanging call is abandoned; until it returns the bus stays closed."""

    def __init__(self, name: str, number: int, i2c: I2c[B]) -> None:
        """Make a device, not open yet; name: as the pilot is told; number: of the bus."""
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
        """Release the bus, after an exchange under way; safe to call twice."""
        session, self._session = self._session, None
        if session is not None:
            session.give_up()
        if self._worker is not None:
            self._worker.close()


class _Session(Generic[B]):
    """An open bus, used only by the thread while an exchange is under way.

    Attributes:
        is_busy: an exchange is under way; set by the caller that starts it.
    """

    def __init__(self, number: int, open_bus: Callable[[int], B]) -> None:
        self._number, self._open_bus = number, open_bus
        self._bus: B | None = None
        self._is_over = False
        self.is_busy = False

    def do(self, exchange: Callable[[B], T]) -> T:
        """Open the bus if it is closed, and run an exchange on it. Raises OSError."""
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
        """Close the bus, now or when the exchange under way returns."""
        self._is_over = True
        if not self.is_busy:
            self._close()

    def _close(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()
