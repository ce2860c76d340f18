"""Checks the camera: is it there, are its pictures of the right size, recent, and well exposed?"""

import asyncio
import statistics

import numpy as np

from landerd.camera_model import CameraModel
from landerd.messages import Frame
from landerd.ports import Camera, DeviceLost, NotInstalled
from landerd.preflight.finding import Finding, gather
from landerd.vision import Vision

CAMERA_S = 3.0  # for how long pictures are taken and measured
_SLOWEST_CAMERA_HZ = 10.0
_OLDEST_PICTURE_S = 0.2
_DARK, _BRIGHT = 12.0, 243.0  # mean grey levels below and above which a picture shows nothing


class CameraCheck:
    """Measures one camera, then looks for the pad in its last picture."""

    def __init__(
        self, vision: Vision, model: CameraModel, fps: float | None, oldest_s: float
    ) -> None:
        """Prepare to measure.

        Args:
            vision: used if the pad is in sight.
            model: the calibration at the size of the pictures.
            fps: configured picture rate, 1/s; None: not known.
            oldest_s: greatest age of pictures that are flown by, s (guidance.lost.after_s).
        """
        self._vision, self._model, self._fps, self._oldest_s = vision, model, fps, oldest_s
        self._shown: Frame | None = None  # the last picture, if nothing is wrong with the camera

    async def run(self, camera: Camera) -> list[Finding]:
        """Open a camera, take pictures, and close it; return the findings on it."""
        try:
            await camera.open()
            first = await camera.newest()  # the start of a stream is slow and not measured
            got = [
                (asyncio.get_running_loop().time(), first),
                *await gather(camera.newest, CAMERA_S),
            ]
        except NotInstalled as e:
            what = f"{e.what}: without pictures the pad is never seen"
            return [Finding("fail", "camera", what, f"{e.mend} (docs/cameras.md)")]
        except DeviceLost as e:
            return [
                Finding(
                    "fail",
                    "camera",
                    f"{e}: without pictures the pad is never seen",
                    "plug it in, close other programs that use it, check camera.*.device and "
                    "format",
                )
            ]
        finally:
            await camera.close()
        findings = [
            Finding("warn", "camera", remark, "see docs/cameras.md")
            for remark in getattr(camera, "remarks", ())
        ]
        looked_at = (
            _size(got, self._model),
            _rate(got, self._fps),
            _age(got),
            _in_time(got, self._oldest_s),
            _light(got),
        )
        found = [f for f in looked_at if f]
        height, width = got[-1][1].image.shape
        if not any(f.level == "fail" for f in found):
            rate = (len(got) - 1) / max(got[-1][0] - got[0][0], 1e-9)
            age_ms = 1e3 * statistics.median(t - frame.t for t, frame in got)
            text = f"{width}x{height}, {rate:.0f} pictures a second, {age_ms:.0f} ms old on arrival"
            found.insert(0, Finding("ok", "camera", text))
            self._shown = got[-1][1]
        return found + findings

    async def pad(self) -> list[Finding]:
        """Return findings on the last picture: other markers than the pad's, or contradictions.

        After all else has been measured, as this takes a second and nothing else runs meanwhile.
        """
        if self._shown is None:
            return []
        vision, image = self._vision, self._shown.image
        try:
            sightings = vision.search_still(self._shown)
        except ValueError:
            return []  # another size or type, on which there is another finding
        seen = vision.other_markers(image, sightings)
        if vision.rings_without_plate(self._shown, sightings):
            seen = ["a ring like the pad's, but not the pad's plate about it", *seen]
        if sightings.other_id is not None:
            seen = [f"another pad's ring, with tag {sightings.other_id} beside it"]
        findings = [
            Finding(
                "warn",
                "pad",
                f"in sight is {other}",
                "if that is on the pad, mend its file (docs/markers.md)",
            )
            for other in seen
        ]
        wrong = vision.disagreement()
        if wrong is None:
            return findings
        return [
            *findings,
            Finding(
                "warn",
                "pad",
                f"its markers contradict each other: {wrong.text}",
                "measure the pad and mend its file, or print it anew (docs/markers.md)",
            ),
        ]


_Frames = list[tuple[float, Frame]]


def _size(got: _Frames, model: CameraModel) -> Finding | None:
    height, width = got[-1][1].image.shape
    if (width, height) == (model.width, model.height):
        return None
    return Finding(
        "fail",
        "calibration",
        f"pictures are {width}x{height}, the calibration is for {model.width}x{model.height}: all "
        "directions would be wrong, so such pictures are not searched",
        "set the camera's size, or calibrate at this size: landerd calibrate camera",
    )


def _rate(got: _Frames, fps: float | None) -> Finding | None:
    rate = (len(got) - 1) / max(got[-1][0] - got[0][0], 1e-9) if len(got) > 1 else 0.0
    if rate >= 0.8 * (fps or _SLOWEST_CAMERA_HZ):
        return None
    wanted = f", {fps:g} were asked for" if fps else ""
    return Finding(
        "fail" if rate < _SLOWEST_CAMERA_HZ else "warn",
        "camera rate",
        f"{rate:.1f} pictures a second{wanted}: the pad's motion is seen late",
        "set a fixed, shorter exposure (cameras slow down in the dark), use a USB 3 port of its "
        "own, or a format with less data (MJPG)",
    )


def _age(got: _Frames) -> Finding | None:
    age = statistics.median(t - frame.t for t, frame in got)
    if -0.02 <= age <= _OLDEST_PICTURE_S:
        return None
    what = f"{age:.2f} s old on arrival" if age > 0 else f"stamped {-age:.2f} s in the future"
    return Finding(
        "warn" if 0 < age < 0.5 else "fail",
        "camera time",
        f"pictures are {what}: they are matched with the attitude of another moment",
        "set time_offset_s of the camera (docs/cameras.md), or use a camera without buffers",
    )


def _in_time(got: _Frames, oldest_s: float) -> Finding | None:
    """Return a finding if a picture becomes too old to be flown by before the next one arrives."""
    spacing = (got[-1][0] - got[0][0]) / max(len(got) - 1, 1)
    age = spacing + statistics.median(t - frame.t for t, frame in got)
    if age < oldest_s:
        return None
    return Finding(
        "fail",
        "camera in time",
        f"pictures are {age:.2f} s old when the next one comes, and flown on for "
        f"{max(oldest_s, 0.0):.2f} s: the pad would always be out of sight",
        "set guidance.lost.after_s to 0.5 and estimation.clock_sigma_s to 0.02, as delivered",
    )


def _light(got: _Frames) -> Finding | None:
    first, last = got[0][1].image, got[-1][1].image
    mean = float(last.mean())
    if len(got) > 2 and np.array_equal(first, last) and np.ptp(last) > 0:
        return Finding(
            "warn",
            "camera picture",
            "all pictures are the same to the last bit: is it frozen?",
            "unplug it and plug it in again",
        )
    if _DARK <= mean <= _BRIGHT:
        return None
    return Finding(
        "warn",
        "camera picture",
        f"the picture is {'black' if mean < _DARK else 'white'}: nothing can be seen in it",
        "take the cap off; set exposure_s and gain for the light there is",
    )
