"""The autopilot: heartbeat, rates, the pilot's gate, and its parameters."""

import asyncio
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from landerd.config.models import Config
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    ClockSync,
    Heartbeat,
    LocalPosition,
    RcChannels,
)
from landerd.ports import Autopilot, DeviceLost
from landerd.preflight.finding import Finding
from landerd.preflight.link import GARBLED, NO_LINK, SILENT, link_kind
from landerd.preflight.parameters import asked_parameters, parameter_findings

AUTOPILOT_S = 6.0  # for how long its messages are received
# Uncertainty of its clock from which on there is a warning: at a turn of 30 degrees a second it is
# 0.3 degrees of attitude.
CLOCK_S = 0.01
PARAMETER_S = 1.0  # interval at which an unanswered request of a parameter is repeated


class AutopilotCheck:
    """Receives an autopilot's messages for a while and returns findings on it.

    Attributes:
        disarmed: whether the last heartbeat said so; False before the first.
    """

    def __init__(self, config: Config, strangers: Mapping[str, int]) -> None:
        """Make one; strangers: see Devices."""
        self.disarmed = False
        self._config = config
        self._strangers = strangers
        self._got: list[tuple[float, AutopilotMessage]] = []

    async def run(self, autopilot: Autopilot, others: asyncio.Event) -> list[Finding]:
        """Open the link, receive, close it, and return the findings.

        Args:
            autopilot: the driver, not open.
            others: set when others no longer need the link, as a gimbal behind the autopilot does.
        """
        names = asked_parameters(self._config)
        tasks: set[asyncio.Task[Any]] = set()
        try:
            await autopilot.open()
            listening = asyncio.create_task(self._listen(autopilot))
            tasks = {listening, asyncio.create_task(self._ask(autopilot, names))}
            await asyncio.wait({listening}, timeout=AUTOPILOT_S)
            if listening.done():
                listening.result()
            findings = self._judge(autopilot)
            tasks.add(asyncio.create_task(others.wait()))
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            return findings
        except DeviceLost as e:
            return [
                Finding(
                    "fail",
                    "autopilot link",
                    f"{e}: landerd cannot fly without the autopilot",
                    NO_LINK[link_kind(self._config.autopilot.url)],
                )
            ]
        finally:
            self.disarmed = False
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await autopilot.close()

    async def _listen(self, autopilot: Autopilot) -> NoReturn:
        loop = asyncio.get_running_loop()
        while True:
            message = await autopilot.receive()
            self._got.append((loop.time(), message))
            if isinstance(message, Heartbeat):
                self.disarmed = not message.armed

    def _judge(self, autopilot: Autopilot) -> list[Finding]:
        if not self._of(Heartbeat):
            return [self._no_heartbeat(Counter(autopilot.counters) + Counter(self._strangers))]
        findings = [self._heartbeat(), *self._rates(), *self._clock(), *self._gate()]
        return findings + parameter_findings(self._config, autopilot.vehicle_parameters)

    async def _ask(self, autopilot: Autopilot, names: Sequence[str]) -> NoReturn:
        while True:
            autopilot.heartbeat()
            for name in names:
                if name not in autopilot.vehicle_parameters:
                    autopilot.ask_parameter(name)
                    await asyncio.sleep(0.02)  # as a slow link also has to carry the streams
            await asyncio.sleep(PARAMETER_S)

    def _of(self, kind: type[Any]) -> list[tuple[float, Any]]:
        return [(t, m) for t, m in self._got if isinstance(m, kind)]

    def _no_heartbeat(self, counters: Mapping[str, int]) -> Finding:
        system = self._config.autopilot.system_id
        if counters.get("not ArduCopter"):
            what = f"the autopilot of system {system} says that it is not ArduCopter"
            return Finding("fail", "heartbeat", what, "landerd lands ArduCopter only")
        if counters.get("badly signed"):
            what = "messages come, but not signed with autopilot.signing_key, or with an old time"
            mend = "the same pass phrase in the autopilot, and GPS, its clock (docs/ardupilot.md)"
            return Finding("fail", "heartbeat", what, mend)
        if counters.get("foreign"):
            what = f"somebody speaks MAVLink, but not the autopilot of system {system}"
            if others := sorted(kind for kind in counters if kind.startswith("system ")):
                what += f": {', '.join(others)}"
            mend = "set autopilot.system_id to SYSID_THISMAV (4.7: MAV_SYSID)"
            return Finding("fail", "heartbeat", what, mend)
        link = link_kind(self._config.autopilot.url)
        if counters:
            what = "bytes come, but they are not MAVLink that can be read"
            return Finding("fail", "heartbeat", f"{what} ({', '.join(counters)})", GARBLED[link])
        what = f"nothing is heard at {self._config.autopilot.url}"
        return Finding("fail", "heartbeat", what, f"is the autopilot on? {SILENT[link]}")

    def _heartbeat(self) -> Finding:
        beat: Heartbeat = self._of(Heartbeat)[-1][1]
        if beat.armed:
            what = f"the vehicle is armed, mode {beat.mode}"
            return Finding("warn", "heartbeat", what, "check before arming")
        return Finding("ok", "heartbeat", f"ArduCopter, disarmed, mode {beat.mode}")

    def _rates(self) -> list[Finding]:
        limits = self._config.freshness
        found = []
        for item, kind, limit, mend in (
            ("attitude", Attitude, limits.attitude_s, "a faster link; SRn_* (4.7: MAVn_*) 0"),
            ("position", LocalPosition, limits.position_s, "wait for GPS and EKF; a faster link"),
            ("RC channels", RcChannels, limits.rc_s, "switch the transmitter on; a faster link"),
        ):
            # The first second is left out, until the streams run.
            got = [(t, m) for t, m in self._of(kind) if t > self._got[0][0] + 1.5]
            if not got:
                what = f"no {item} comes: landerd does not fly without"
                found.append(Finding("fail", item, what, mend))
                continue
            span = max(self._got[-1][0] - self._got[0][0] - 1.5, 1e-9)
            rate, age = len(got) / span, statistics.median(t - m.t for t, m in got)
            text = f"{rate:.0f} a second, {1e3 * age:.0f} ms old"
            if rate * limit < 2.0 or age > 0.5 * limit:
                what = f"{text}: data older than {limit:g} s are not flown on"
                found.append(Finding("fail", item, what, mend))
            else:
                found.append(Finding("ok", item, text))
        return found

    def _clock(self) -> list[Finding]:
        """Return how well the autopilot's clock is known: landerd learns its error in flight."""
        got = self._of(ClockSync)
        if not got:
            what = "TIMESYNC is not answered: data are taken for as young as they can be"
            return [Finding("warn", "clock", what, "MAVLink 2 on this port; a newer ArduPilot")]
        uncertainty_s = got[-1][1].uncertainty_s
        text = f"known to {1e3 * uncertainty_s:.0f} ms, half the quickest round trip"
        if uncertainty_s < CLOCK_S:
            return [Finding("ok", "clock", text)]
        what = f"{text}: all data count as so much older"
        return [Finding("warn", "clock", what, "a faster or direct link to the autopilot")]

    def _gate(self) -> list[Finding]:
        got = self._of(RcChannels)
        if not got:
            return []
        rc, last = self._config.rc, got[-1][1].channels_us
        pulse = last[rc.gate_channel - 1] if rc.gate_channel <= len(last) else 0
        name = f"RC {rc.gate_channel}"
        if pulse == 0:
            what = f"{name} has no signal: you could not hand over to landerd, nor take back"
            mend = "give the channel to a switch in the transmitter, or set rc.gate_channel"
            return [Finding("fail", "gate", what, mend)]
        if pulse > rc.gate_threshold_us:
            place = "in its middle" if pulse <= rc.land_threshold_us else "high"
            what = f"{name} is {place} ({pulse} us): landerd flies only after it was low"
            return [Finding("warn", "gate", what, "put the switch low; is it the right channel?")]
        what = f"{name} is low ({pulse} us)"
        if rc.land_threshold_us:
            what += (
                f"; above {rc.gate_threshold_us} us it holds, above {rc.land_threshold_us} lands"
            )
        return [Finding("ok", "gate", what)]
