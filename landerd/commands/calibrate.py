"""`landerd calibrate`: chooses between camera and gimbal."""

import argparse

from landerd.commands import calibrate_camera, calibrate_gimbal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the two devices with their arguments."""
    devices = parser.add_subparsers(metavar="DEVICE", required=True)
    camera = devices.add_parser(
        "camera",
        help="lens, from pictures of a board",
        description="Find out what a camera's lens does, from pictures of a board.",
    )
    calibrate_camera.add_arguments(camera)
    camera.set_defaults(calibrate=calibrate_camera.run)
    gimbal = devices.add_parser(
        "gimbal",
        help="signs, zeros or tables, and delays, from views of a pad",
        description="Move a gimbal about and find out how it answers, from views of a pad that "
        "lies still. The vehicle stands disarmed.",
        epilog="example: landerd calibrate gimbal -c landerd.yaml -o gimbal-found.yaml",
    )
    calibrate_gimbal.add_arguments(gimbal)
    gimbal.set_defaults(calibrate=calibrate_gimbal.run)


def run(args: argparse.Namespace) -> int:
    """Calibrate the device that was named."""
    code: int = args.calibrate(args)
    return code
