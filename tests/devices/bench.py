"""What the checks in the virtual machine and in the container share."""

import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from typing import Any


def sh(command: str) -> str:
    """Run a command and return its output."""
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    return (done.stdout + done.stderr).strip()


def wait_for(done: Callable[[], bool], what: str, limit_s: float = 60.0) -> float:
    """Wait for a condition; return how long it took, s."""
    start = time.monotonic()
    while not done():
        assert time.monotonic() - start < limit_s, f"{what} did not come"
        time.sleep(0.02)
    return time.monotonic() - start


def show(key: str) -> str:
    """Return a property of the service."""
    return sh(f"systemctl show landerd -p {key} --value")


def run_checks(module: Mapping[str, Any], name: str) -> int:
    """Run all functions check_... of a module in their order; the last line is the verdict."""
    checks = [check for key, check in module.items() if key.startswith("check_")]
    failed, began = 0, time.monotonic()
    for check in checks:
        print(check.__name__.removeprefix("check_").replace("_", " "), flush=True)
        try:
            check()
        except Exception:
            failed += 1
            traceback.print_exc(file=sys.stdout)
    took = f"{time.monotonic() - began:.0f} s"
    if failed:
        print(f"{failed} OF {len(checks)} CHECKS OF THE {name} FAILED in {took}", flush=True)
    else:
        print(f"ALL {len(checks)} CHECKS OF THE {name} PASSED in {took}", flush=True)
    return failed
