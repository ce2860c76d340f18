"""Faults of the scene that the camera sees: dirt, shade, decoys, a second pad, no pad."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.sim.faults.bench import Bench, Effect, changed
from hw.sim.picture.camera import Renders
from hw.sim.picture.other_pads import SecondPad


@contextmanager
def _seen_through(bench: Bench, renderer: Renders) -> Iterator[None]:
    bench.camera.show(renderer)
    yield
    bench.camera.hide(renderer)


@contextmanager
def _dirty(bench: Bench, severity: float) -> Iterator[None]:
    options = bench.world.options
    pad = options.pad.model_copy(update={"dirt": bench.between(0.1, 0.6, severity)})
    with _seen_through(bench, bench.renderer(options.render, pad)):
        yield


@contextmanager
def _shaded(bench: Bench, severity: float) -> Iterator[None]:
    options = bench.world.options
    shade = {"leaf_shade": bench.between(0.2, 0.9, severity)}
    render = options.render.model_copy(update=shade)
    with _seen_through(bench, bench.renderer(render, options.pad)):
        yield


@contextmanager
def _decoys(bench: Bench, severity: float) -> Iterator[None]:
    options = bench.world.options
    count = round(bench.between(5, 30, severity))
    render = options.render.model_copy(update={"look_alikes": count})
    with _seen_through(bench, bench.renderer(render, options.pad)):
        yield


@contextmanager
def _gone(bench: Bench, severity: float) -> Iterator[None]:
    with changed(bench.camera.faults, pad_covered=True):
        yield


@contextmanager
def _second(bench: Bench, severity: float) -> Iterator[None]:
    aside = bench.between(6.0, 2.0, severity) * bench.rng.choice((-1.0, 1.0))
    second = SecondPad(bench.camera.pictures, bench.plate, bench.frustum, (0.0, aside, 0.0))
    with _seen_through(bench, second):
        yield


FAULTS: Mapping[str, Effect] = {
    "pad-dirty": _dirty,
    "pad-shaded": _shaded,
    "pad-gone": _gone,
    "decoys": _decoys,
    "second-pad": _second,
}
