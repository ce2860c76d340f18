"""The `sim.camera` block: when the simulated camera exposes and delivers, and its sensor.

The defaults are an ideal sensor behind the configured lens: linear, at an exact rate, with all rows
exposed at once. Constant noise, focus and light are in `sim.render`.
"""

from typing import Annotated, Literal

from pydantic import Field

from landerd.section import Section

Share = Annotated[float, Field(ge=0, le=1)]
Pixels = Annotated[float, Field(ge=-50, le=50)]


class AutoExposureOptions(Section):
    """How the camera controls its exposure."""

    # Mean light to which it exposes, share of full scale: cameras measure before the tone curve.
    target: Annotated[float, Field(ge=0.02, le=0.9)] = 0.17
    lag_s: Annotated[float, Field(ge=0.02, le=5)] = 0.3  # time constant of the exposure in stops
    longest_s: Annotated[float, Field(gt=0, le=0.05)] = 0.02  # exposure time; then gain is raised
    gain_max: Annotated[float, Field(ge=1, le=64)] = 16.0


class ToneOptions(Section):
    """The tone curve from light to grey level."""

    # contrast: sRGB with a full S-curve on top, like a camera's "vivid" style
    curve: Literal["linear", "srgb", "gamma", "contrast"] = "linear"
    gamma: Annotated[float, Field(ge=1, le=4)] = 2.2  # exponent of the curve `gamma`
    contrast: Share = 0.0  # share of an S-curve on top


class NoiseOptions(Section):
    """Noise that grows with the light; `sim.render.noise_sigma` is the rest, before gain."""

    # Variance, grey levels^2, per grey level of light at gain 1: 255 over the full well, electrons.
    shot: Annotated[float, Field(ge=0, le=2)] = 0.0


class VibrationOptions(Section):
    """Vibration of the camera relative to the airframe, about the camera's x and y axes."""

    deg: Annotated[float, Field(ge=0, le=2)] = 0.0  # amplitude
    hz: Annotated[float, Field(ge=1, le=400)] = 60.0


class CalibrationErrorOptions(Section):
    """How the true lens differs from the configured calibration."""

    focal: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0  # relative, of the focal length
    principal_px: tuple[Pixels, Pixels] = (0.0, 0.0)  # of the principal point: right, down
    distortion: Annotated[float, Field(ge=-1, le=1)] = 0.0  # relative, of each coefficient


class SimCameraOptions(Section):
    """The simulated camera."""

    fps: Annotated[float, Field(gt=0, le=120)] = 30.0
    fps_jitter: Annotated[float, Field(ge=0, le=0.2)] = 0.0  # sd, share of the period
    # With auto exposure, the exposure time for which `sim.render.illumination` is given.
    exposure_s: Annotated[float, Field(gt=0, le=0.05)] = 0.008
    latency_s: Annotated[float, Field(ge=0, le=0.5)] = 0.06  # middle of exposure to delivery
    latency_jitter_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0  # sd
    clock_offset_s: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.005  # error of time stamps
    clock_jitter_s: Annotated[float, Field(ge=0, le=0.05)] = 0.0  # sd of time stamps
    drop: Share = 0.0  # probability that a picture is lost
    readout_s: Annotated[float, Field(ge=0, le=0.05)] = 0.0  # from the first row to the last
    exposure: Literal["fixed", "auto", "ordered"] = "fixed"  # ordered: landerd controls it
    auto_exposure: AutoExposureOptions = AutoExposureOptions()
    tone: ToneOptions = ToneOptions()
    black_level: Annotated[float, Field(ge=0, le=100)] = 0.0  # grey level of no light
    noise: NoiseOptions = NoiseOptions()
    jpeg_quality: Annotated[int, Field(ge=10, le=100)] | None = None  # null: not compressed
    sharpening: Annotated[float, Field(ge=0, le=4)] = 0.0  # share of the unsharp mask added
    vignetting: Annotated[float, Field(ge=0, le=0.9)] = 0.0  # share of light lost in the corners
    lens_dirt: Share = 0.0  # share of light lost under the thickest spot
    vibration: VibrationOptions = VibrationOptions()
    calibration_error: CalibrationErrorOptions = CalibrationErrorOptions()
