"""The bench of an export sends frames that fit its build, and expects what they give."""

import dataclasses

import numpy as np
import pytest

from hdl.build import BUILDS
from hdl.export.accelerator_bench import FRAME_PX, SampleFrames, control_streams, list_writes
from hdl.registers.register_map import REGISTERS
from hdl.registers.shell_register_map import ALL_REGISTERS

CONFIG = BUILDS["tiny"].config


def test_frames_are_good_and_match() -> None:
    frames = SampleFrames(CONFIG)
    assert all(status["good"] for status in frames.statuses)
    assert np.count_nonzero(frames.matches["verdict"]) > 20
    assert list(frames.packets) == ["features", "matches"]


def test_a_threshold_is_raised_until_the_features_fit() -> None:
    few = dataclasses.replace(CONFIG, front_end=dataclasses.replace(CONFIG.front_end, max_features=16))
    frames = SampleFrames(few)
    assert frames.config.front_end.threshold > CONFIG.front_end.threshold
    assert max(int(status["features"]) for status in frames.statuses) <= 16


@pytest.mark.parametrize(("video_bits", "pixels", "low_bits"), [(32, 1, 8), (8, 1, 8), (48, 2, 24), (16, 2, 8)])
def test_beats_hold_the_pixels_in_order(video_bits: int, pixels: int, low_bits: int) -> None:
    frames = SampleFrames(CONFIG)
    beats = frames.beats(video_bits)
    assert len(beats) == 2 * FRAME_PX**2 // pixels
    words = [beat["s_axis_video_tdata"] for beat in beats]
    found = [word >> low_bits * place & 0xFF for word in words for place in range(pixels)]
    assert found == np.concatenate([image.ravel() for image in frames.images]).tolist()
    starts = [number for number, beat in enumerate(beats) if beat["s_axis_video_tuser"]]
    assert starts == [0, len(beats) // 2]
    assert sum(beat["s_axis_video_tlast"] for beat in beats) == 2 * FRAME_PX


def test_everything_is_set_before_it_starts_and_each_write_is_answered() -> None:
    writes = list_writes(CONFIG)
    control = next(register.offset for register in REGISTERS if register.name == "CONTROL")
    assert [address for address, _ in writes].index(control) == len(writes) - 1
    sent, answers = control_streams(writes)
    assert len(answers["s_axi_ctrl_b"]) == len(sent["s_axi_ctrl_w"]) == len(writes)


def test_the_painter_is_on_before_its_pose_and_both_before_the_frames() -> None:
    writes = list_writes(CONFIG, pose_set=1, pose_frame=0, painter_enable=1, pose_h22=1)
    offsets = {register.name: register.offset for register in ALL_REGISTERS}
    last = [address for address, _ in writes[-3:]]
    assert last == [offsets[name] for name in ("PAINTER", "POSE_SET", "CONTROL")]
