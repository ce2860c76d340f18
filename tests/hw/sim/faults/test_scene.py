"""Faults of the scene before the camera that overlap."""

from types import SimpleNamespace
from typing import cast

from hw.sim.camera_options import SimCameraOptions
from hw.sim.faults.bench import Bench
from hw.sim.faults.scene import FAULTS
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.camera import Renders, SimCamera
from hw.sim.snapshot import Snapshot


def test_after_overlapping_faults_the_world_is_as_it_was() -> None:
    """Once, the first of two that overlapped stayed visible for ever."""

    def truth(t: float) -> Snapshot:
        raise AssertionError("no picture is taken")

    def renderer(render: RenderOptions, pad: PadOptions) -> Renders:
        return cast(Renders, SimpleNamespace(decoys=render.look_alikes, dirt=pad.dirt))

    plain = renderer(RenderOptions(), PadOptions())
    camera = SimCamera(plain, truth, SimCameraOptions())
    options = SimpleNamespace(render=RenderOptions(), pad=PadOptions())
    bench = cast(
        Bench,
        SimpleNamespace(
            camera=camera,
            renderer=renderer,
            world=SimpleNamespace(options=options),
            between=lambda least, most, severity: least + severity * (most - least),
        ),
    )
    decoys, dirty = FAULTS["decoys"](bench, 1.0), FAULTS["pad-dirty"](bench, 1.0)
    decoys.__enter__()
    dirty.__enter__()
    decoys.__exit__(None, None, None)
    assert cast(SimpleNamespace, camera.pictures).dirt == 0.6
    dirty.__exit__(None, None, None)
    assert camera.pictures is plain
