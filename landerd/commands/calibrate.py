"""`landerd calibrate`: the subcommands `camera` and `gimbal`."""

import argparse

from landerd.commands import calibrate_camera, calibrate_gimbal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the two devices with their arguments."""
    devices = parser.add_subparsers(metavar="DEVICE", required=True)
    camera = devices.add_parser(
        "camera",
        help="focal length and distortion of the lens, from pictures of a board",
        description="Calibrate a camera's lens, from pictures of a board.",
        epilog="example: landerd calibrate camera photos/ --size 9x6 --square 0.025 "
        "-o my-camera.yaml",
    )
    calibrate_camera.add_arguments(camera)
    camera.set_defaults(calibrate=calibrate_camera.run)
    gimbal = devices.add_parser(
        "gimbal",
        help="signs, zeros or tables, and delays, from views of a pad",
        description="Move a gimbal and measure how it follows its orders, from pictures of a pad "
        "that lies still. The vehicle stands disarmed.",
        epilog="example: landerd calibrate gimbal -c landerd.yaml -o gimbal-found.yaml",
    )
    calibrate_gimbal.add_arguments(gimbal)
    gimbal.set_defaults(calibrate=calibrate_gimbal.run)


def run(args: argparse.Namespace) -> int:
    """Calibrate the device that was named; return the exit code."""
    code: int = args.calibrate(args)
    return code
