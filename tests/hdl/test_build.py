"""What can be built, and what is refused before anything is made."""

import re
from dataclasses import replace
from typing import Any

import pytest

from golden_model.config import PRESETS, Config, EstimatorConfig, FrontEndConfig
from hdl.build import BUILDS, Build

WITH_ESTIMATOR = Config(estimator=EstimatorConfig())
# Enough with one pixel per clock.
NARROW = Config(front_end=FrontEndConfig(descriptor="thesis-ilbp-1", border_px=9))
NEEDS_10 = "border_px is 9; with this detector and descriptor the hardware needs 10"
WITH_16_FEATURES = Config(front_end=FrontEndConfig(max_features=16))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"max_width_px": 63}, "`max_width_px` is 63; it must be a whole number from 64 to 4096"),
        ({"max_height_px": 5000}, "`max_height_px` is 5000; it must be a whole number from 64 to 4096"),
        ({"lanes": 3}, "`lanes` is 3; valid: 2, 4, 8, 16, 32, 64, 128"),
        ({"lanes": 256}, "`lanes` is 256; valid: 2, 4, 8, 16, 32, 64, 128"),
        ({"lanes": 32, "config": WITH_16_FEATURES}, "`lanes` is 32; valid: 2, 4, 8, 16"),
        ({"video_bits": 12}, "`video_bits` with shell 'streams' is 12; valid: 32, 24, 8, 48, 16"),
        ({"shell": "camera"}, "`video_bits` with shell 'camera' is 32; valid: 24, 8"),
        ({"shell": "serial"}, "`video_bits` with shell 'serial' is 32; valid: 8"),
        (
            {"shell": "serial", "video_bits": 8, "max_width_px": 710, "max_height_px": 600},
            "is 426,000; with shell 'serial' a whole frame waits in the board's block RAM, which holds 425,920 at most",
        ),
        ({"shell": "shell"}, "shell is 'shell'; valid: streams, camera, serial"),
        ({"painter": True, "config": WITH_ESTIMATOR}, "painter needs the shell 'camera' and an estimator"),
        ({"painter": True, "shell": "camera", "video_bits": 8}, "painter needs the shell 'camera' and an estimator"),
        ({"config": NARROW, "video_bits": 16}, NEEDS_10),
        ({"config": replace(PRESETS["aerial"], matcher=PRESETS["thesis"].matcher)}, "needs the gray window"),
    ],
)  # fmt: skip
def test_what_cannot_be_built_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        Build(**changes)
    assert "\n" not in str(refused.value)


def test_what_follows_from_a_build() -> None:
    assert BUILDS["pynq_z2"] == Build()
    assert Build().outputs == ("features", "matches")
    assert Build(config=WITH_ESTIMATOR).outputs == ("features", "matches", "homographies")
    assert Build(config=WITH_ESTIMATOR).record_words == {"features": 4, "matches": 3, "homographies": 8}
    assert [Build(video_bits=bits).pixels_per_clock for bits in (32, 24, 8, 48, 16)] == [1, 1, 1, 2, 2]


def test_the_named_builds_are_as_documented() -> None:
    """Levels, features, lanes, size, width of the video and shell; none has an estimator or a painter."""
    described = {}
    for name, build in BUILDS.items():
        front_end, size_px = build.config.front_end, (build.max_width_px, build.max_height_px)
        described[name] = (
            front_end.levels, front_end.max_features, build.lanes, *size_px, build.video_bits, build.shell
        )  # fmt: skip
        assert (build.painter, build.config.estimator) == (False, None)
    assert described == {
        "pynq_z2": (2, 2048, 16, 1920, 1080, 32, "streams"), "camera": (2, 2048, 16, 1920, 1080, 24, "camera"),
        "ulx3s": (1, 1024, 4, 320, 240, 8, "serial"), "tiny": (1, 64, 2, 128, 128, 32, "streams"),
    }  # fmt: skip
