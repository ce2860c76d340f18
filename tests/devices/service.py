"""Run as root in a container with a real systemd: the service, and a vehicle outside of it.

The container is booted with landerd installed out of its wheel (install.sh), the service enabled
and its camera not there.
"""

import asyncio
import math
import os
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.links.udp import SILENT_S
from landerd.runtime.clock import run_realtime
from landerd.simulation.flight import Simulation
from tests.devices.bench import run_checks, sh, show, wait_for
from tests.devices.outside import CONFIG, SocketCamera, flying

UNIT = "/etc/systemd/system/landerd.service"
LOW, HIGH = 1100, 1900
# The judge shares its process with the simulated world, which sees set-points late while it draws.
TIMED = ("3: horizontal", "3: vertical", "3: set-points less often")
NOTHING = "nothing left to do"
TOO_LATE_S = 0.15  # pauses as long as this make old data of new ones: nothing is judged then


class Orders:
    """Counts landerd's flight orders on the wire."""

    def __init__(self, simulation: Simulation) -> None:
        self.setpoints: list[tuple[float, float]] = []  # time, fastest of its speeds
        self.late_s = 0.0  # longest pause of this process
        self._codec = mavlink.MAVLink(None)
        self._judge = simulation.rules.from_landerd
        simulation.link.tap = self._tap

    def _tap(self, t: float, data: bytes) -> None:
        for m in self._codec.parse_buffer(bytearray(data)) or []:
            if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                speed = max(math.hypot(m.vx, m.vy, m.vz), abs(m.yaw_rate))
                self.setpoints.append((t, speed))
        self._judge(t, data)

    async def watch_the_time(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + 0.02
            await asyncio.sleep(0.02)
            self.late_s = max(self.late_s, loop.time() - due)

    @property
    def longest_pause_s(self) -> float:
        """Return the longest pause, of this process or between two of landerd's set-points, s."""
        times = [t for t, _ in self.setpoints]
        return max(self.late_s, *(after - before for before, after in pairwise(times)))

    def since(self, t: float) -> list[float]:
        """Return the speeds ordered since a time."""
        return [speed for at, speed in self.setpoints if at >= t]


async def until(done: Callable[[], bool], what: str, limit_s: float = 20.0) -> float:
    """Wait for a condition; return how long it took, s."""
    loop = asyncio.get_running_loop()
    start = loop.time()
    while not done():
        if loop.time() - start > limit_s:
            raise AssertionError(f"{what} did not come")
        await asyncio.sleep(0.01)
    return loop.time() - start


def with_vehicle(use: Callable[[Simulation, Orders], Awaitable[None]]) -> None:
    async def main() -> None:
        async with flying(CONFIG, "udpout:127.0.0.1:14550") as simulation:
            orders = Orders(simulation)
            watching = asyncio.create_task(orders.watch_the_time())
            switch(simulation, LOW)
            # The vehicle before this one is the only one listened to until it is thought gone.
            await asyncio.sleep(SILENT_S + 3.0)
            await until(lambda: "is low" in texts(simulation), "the low switch")
            try:
                await use(simulation, orders)
            except AssertionError:
                print(f"  the pilot was told: {texts(simulation)}")
                print(sh("journalctl -u landerd -o cat -n 20"))
                raise
            finally:
                watching.cancel()

    run_realtime(main())


def switch(simulation: Simulation, pulse: int) -> None:
    simulation.autopilot.pilot.set(simulation.config.rc.gate_channel, pulse)


def texts(simulation: Simulation, since: float = 0.0) -> str:
    return "; ".join(text for t, text in simulation.rules.texts if t >= since)


def is_new(pid: str) -> bool:
    return show("ActiveState") == "active" and show("MainPID") not in (pid, "0")


def as_user(command: str) -> str:
    """Run a command as a user would, with the installed program and not the one tested here."""
    return sh(f"env -u PYTHONPATH {command}")


def wheel(folder: str) -> str:
    return sh(f"ls /checks/{folder}/landerd-*.whl")


# ---- the unit ----


def check_systemd_has_nothing_to_say_about_the_unit() -> None:
    assert sh(f"systemd-analyze verify --man=no {UNIT}") == ""
    sh(f"cp {UNIT} /etc/systemd/system/landerd@.service")
    sh("mkdir /etc/systemd/system/landerd@.service.d")
    for dropin in ("navio2", "jetson"):
        sh(f"cp /repo/systemd/{dropin}.conf /etc/systemd/system/landerd@.service.d")
        assert sh("systemd-analyze verify --man=no landerd@boat.service") == "", dropin
    sh("rm -r /etc/systemd/system/landerd@.service*")
    exposure = sh("systemd-analyze security --no-pager landerd").splitlines()[-1]
    print(" ", exposure)
    assert float(exposure.split(": ")[1].split()[0]) <= 2.0


def check_it_was_started_at_boot_without_any_device() -> None:
    took = wait_for(lambda: show("ActiveState") == "active", "ready", 30.0)
    print(f"  ready {took:.1f} s after the checks began, {show('StatusText')}")
    assert show("NRestarts") == "0"
    warnings = sh("journalctl -u landerd -o cat -p warning")
    assert "camera lost" in warnings, warnings
    status = sh(f"cat /proc/{show('MainPID')}/status")
    assert "Seccomp:\t2" in status
    assert "NoNewPrivs:\t1" in status
    assert f"Uid:\t{sh('id -u landerd')}" in status
    assert {*sh("id -nG landerd").split()} == {"landerd", "dialout", "video", "i2c", "gpio"}


def check_installing_again_does_nothing_and_upgrading_waits_for_the_ground() -> None:
    assert as_user(f"python3 {wheel('wheel')}/landerd install --board pixhawk-usb") == NOTHING
    assert as_user("landerd install --board pixhawk-usb") == NOTHING
    said = as_user(f"python3 {wheel('next-wheel')}/landerd install --board pixhawk-usb")
    assert said.splitlines()[-1] == (
        "landerd is running, and may be flying: on the ground, sudo systemctl stop landerd"
    )
    assert "0.1.0" in as_user("landerd --version")


# ---- in flight ----


def check_it_lands_a_vehicle_whose_camera_came_late() -> None:
    async def use(simulation: Simulation, orders: Orders) -> None:
        switch(simulation, HIGH)
        await until(lambda: simulation.score.disarm_t is not None, "the landing", 60.0)
        contact = simulation.score.contact
        broken = [rule for rule in simulation.rules.broken if not rule.startswith(TIMED)]
        assert contact is not None
        print(
            f"  landed {1e3 * contact.error_m:.0f} mm off after {contact.t - began:.0f} s; "
            f"rules broken: {broken or 'none'}"
        )
        assert simulation.score.landed
        assert contact.error_m < 0.15
        if orders.longest_pause_s < TOO_LATE_S:
            assert not broken
        else:
            print(f"  not judged: this machine stood still for {orders.longest_pause_s:.2f} s")
        assert "landed" in texts(simulation)

    began = SILENT_S + 3.0
    with_vehicle(use)
    assert show("NRestarts") == "0"
    assert "camera lost" in sh("journalctl -u landerd -o cat -p warning")
    logs = sh("ls /var/lib/landerd/logs")
    assert ".mcap" in logs, logs


def check_hung_in_flight_it_is_restarted_and_silent_until_the_switch_was_low() -> None:
    async def use(simulation: Simulation, orders: Orders) -> None:
        loop = asyncio.get_running_loop()
        switch(simulation, HIGH)
        await until(lambda: any(speed > 0.05 for _, speed in orders.setpoints), "flying")
        pid = await asyncio.to_thread(show, "MainPID")
        os.kill(int(pid), signal.SIGSTOP)
        hung, hung_us = loop.time(), 1e6 * time.monotonic()
        await until(lambda: is_new(pid), "ready", 20.0)
        ready = loop.time() - hung
        running = 1e-6 * (float(show("ExecMainStartTimestampMonotonic")) - hung_us)
        print(f"  hung: another process after {running:.2f} s, ready after {ready:.2f} s")
        assert running < 3.0
        assert show("NRestarts") == "1"
        await until(lambda: "low, then high" in texts(simulation, hung), "the notice", 20.0)
        await asyncio.sleep(2.0)
        assert orders.since(hung + 0.1) == []
        switch(simulation, LOW)
        await asyncio.sleep(1.0)
        assert orders.since(hung + 0.1) == []
        switch(simulation, HIGH)
        high = loop.time()
        await until(lambda: any(s > 0.02 for s in orders.since(high)), "flying again")
        print(f"  flies again {loop.time() - high:.2f} s after the switch was low and high")

        # And told to stop in flight:
        told = loop.time()
        stopping = asyncio.create_task(asyncio.to_thread(sh, "systemctl stop landerd"))
        await stopping
        took = loop.time() - told
        print(f"  stopped in {took:.2f} s, {show('Result')}")
        assert took < 2.0
        assert show("Result") == "success"
        assert orders.since(told + 0.3), "no orders to stop"
        assert max(orders.since(told + 0.3)) == 0.0
        end = loop.time()
        await asyncio.sleep(0.5)
        assert orders.since(end) == []
        print(f"  said: {texts(simulation, told)}")
        assert "told to stop" in texts(simulation, told)

    with_vehicle(use)


# ---- on the ground ----


def check_a_wrong_configuration_is_told_and_not_tried_again() -> None:
    path = CONFIG.with_name("wrong.yaml")
    path.write_text("include: [default.yaml]\nrc: {gate_channel: 99}\n")
    dropin = "/etc/systemd/system/landerd.service.d"
    sh(f"mkdir -p {dropin}")
    program = "/opt/landerd/venv/bin/landerd"
    sh(f"printf '[Service]\\nExecStart=\\nExecStart={program} run -c {path}\\n' > {dropin}/x.conf")
    sh("systemctl daemon-reload; systemctl reset-failed landerd; systemctl restart landerd")
    wait_for(lambda: show("ActiveState") == "failed", "the end", 10.0)
    time.sleep(1.0)  # longer than RestartSec
    assert show("NRestarts") == "0"
    journal = sh("journalctl -u landerd -o cat -n 20")
    assert f"{path}:2: rc.gate_channel: found 99" in journal, journal
    assert "Traceback" not in journal
    sh(f"rm {dropin}/x.conf {path}; systemctl daemon-reload; systemctl reset-failed landerd")


# ---- upgrade and uninstall ----


def check_an_upgrade_keeps_the_configuration_and_tells_of_changed_keys() -> None:
    CONFIG.write_text(CONFIG.read_text() + "vision: {max_sigma_m: 0.9}\n")
    before = CONFIG.read_text()
    said = as_user(f"python3 {wheel('next-wheel')}/landerd install --board navio2")
    print("  " + said.replace("\n", "\n  "))
    assert "another default: vision.min_ring_px: 9.0, was 10.0" in said
    assert "99.0" in as_user("/opt/landerd/venv/bin/python -m pip show landerd")
    assert CONFIG.read_text() == before
    assert "CPUAffinity=2 3" in sh("systemctl cat landerd")
    assert as_user("landerd install --board navio2") == NOTHING


def check_uninstalled_it_leaves_logs_and_configuration() -> None:
    said = as_user("landerd uninstall")
    print("  " + said.replace("\n", "\n  "))
    left = sh("find / -xdev -name '*landerd*' -not -path '/proc/*' -not -path '/repo*'").split()
    mine = ("/etc/landerd", "/var/lib/landerd", "/usr/lib/python3/dist-packages/landerd.pth")
    # program.conf is an administrator's own
    dropins = "/etc/systemd/system/landerd.service.d"
    others = [path for path in left if not path.startswith((*mine, dropins, "/run", "/checks"))]
    assert others == [], others
    assert sh(f"ls {dropins}") == "program.conf"
    assert CONFIG.exists()
    assert ".mcap" in sh("ls /var/lib/landerd/logs")
    assert sh("find /etc /var /opt /usr -nouser") == ""
    assert "no such user" in sh("id landerd")
    assert sh("getent group gpio") == ""
    assert sh("getent group dialout") != ""  # was there before
    assert sh("systemctl is-enabled landerd") != "enabled"


if __name__ == "__main__":
    assert not SocketCamera.path.exists()
    sys.exit(run_checks(globals(), "SERVICE"))
