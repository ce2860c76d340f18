"""`landerd uninstall`: removes what `landerd install` installed; logs and configuration stay."""

import argparse

from landerd.commands.install import add_root, carry_out
from landerd.commands.shared import refusing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_root(parser)


def run(args: argparse.Namespace) -> int:
    """Uninstall and return 0. Raises InputError if a step fails or it needs root."""
    from landerd.installation.service import CONFIGURATION, STATE, uninstall_steps
    from landerd.installation.steps import InstallError

    with refusing(InstallError, OSError):
        steps = uninstall_steps(args.root)
        carry_out(steps, args)
    if steps and not args.dry_run:
        print(f"left: configuration in {CONFIGURATION.parent}, logs in {STATE}")
    return 0
