"""Faults of pictures: lost, late, repeated, out of order, wrongly stamped, spoilt."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from hw.sim.faults.bench import Bench, Effect, changed
from hw.sim.picture.camera import U8

Settings = dict[str, Any]  # fields of CameraFaults


def _with(settings: Callable[[float], Settings]) -> Effect:
    """Return a fault that sets fields of CameraFaults by its severity."""

    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        with changed(bench.camera.faults, **settings(severity)):
            yield

    return effect


def _spoilt(spoil: Callable[[U8], U8], *, hides_pad: bool) -> Effect:
    return _with(lambda _: {"spoil": spoil, "hides_pad": hides_pad})


def _half(image: U8) -> U8:
    spoilt = image.copy()
    spoilt[len(image) // 2 :] = 0
    return spoilt


@contextmanager
def _raises(bench: Bench, severity: float) -> Iterator[None]:
    bench.camera.faults.raises = ZeroDivisionError("in the simulated camera's driver")
    yield


FAULTS: Mapping[str, Effect] = {
    "pictures-lost": _with(lambda s: {"drop": 0.3 + 0.7 * s}),
    "pictures-late": _with(lambda s: {"late_s": 0.1 + 0.9 * s}),
    "pictures-repeated": _with(lambda s: {"frozen": True}),
    "pictures-swapped": _with(lambda s: {"swap": 0.1 + 0.9 * s}),
    "pictures-frozen": _with(lambda s: {"frozen_fresh": True}),
    "pictures-black": _spoilt(np.zeros_like, hides_pad=True),
    "pictures-white": _spoilt(lambda image: np.full_like(image, 255), hides_pad=True),
    "pictures-half": _spoilt(_half, hides_pad=False),
    "pictures-mirrored": _spoilt(
        lambda image: np.ascontiguousarray(image[:, ::-1]), hides_pad=False
    ),
    "pictures-small": _with(lambda s: {"wrong_size": True}),
    "pictures-wide": _with(lambda s: {"wrong_type": True}),
    "stamps-shifted": _with(lambda s: {"time_ahead_s": -0.01 - 0.29 * s}),
    "stamps-ahead": _with(lambda s: {"time_ahead_s": 0.01 + 2.99 * s}),
    "stamps-jumping": _with(lambda s: {"time_jumps_s": 0.01 + 0.19 * s}),
    "stamps-frozen": _with(lambda s: {"time_stands": True}),
    "camera-lost": _with(lambda s: {"disconnected": True}),
    "camera-raises": _raises,
}
