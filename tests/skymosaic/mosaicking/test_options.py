"""The options: keyword arguments are held to the fields, and each option applies or is refused with the reason."""

import dataclasses
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from IPython.core.completer import IPCompleter, provisionalcompleter

from golden_model.config import PRESETS
from golden_model.feature.ilbp import PATTERNS
from skymosaic import LiveMosaic, Tracker, extract, mosaic, mosaics, register, register_pairs
from skymosaic.common.errors import InputError
from skymosaic.common.options import GROUPS, options_of
from skymosaic.features import descriptors, detectors
from skymosaic.features.backends import BACKENDS
from skymosaic.features.descriptors import TRACKED, WINDOWS_PX
from skymosaic.features.detectors import FRONT_END_DETECTORS
from skymosaic.geometry.estimators import FABRIC, FUZZY_RANSAC, PROSAC
from skymosaic.imagery.lens import Lens
from skymosaic.maps.positions import Positions
from skymosaic.mosaicking.options import LiveOptions, MosaicOptions
from skymosaic.registration.options import FeatureOptions, RegistrationOptions
from skymosaic.tracking.tracker import TrackerOptions
from tools.keywords import STUB, describe_keywords

TAKERS: dict[Callable[..., object], type] = {
    extract: FeatureOptions,
    register: RegistrationOptions,
    register_pairs: RegistrationOptions,
    mosaic: MosaicOptions,
    mosaics: MosaicOptions,
    LiveMosaic: LiveOptions,
    Tracker: TrackerOptions,
}
"""What takes options, with the class of the object."""


@pytest.mark.parametrize(("function", "options"), TAKERS.items())
def test_signature_lists_the_options(function: Callable[..., object], options: type[Any]) -> None:
    fields, types = dataclasses.fields(options), get_type_hints(options)
    shown = inspect.signature(function).parameters
    assert {name: (each.default, each.annotation) for name, each in shown.items() if name in types} == {
        field.name: (field.default, types[field.name]) for field in fields
    }
    assert "changes" not in shown


def test_keywords_are_completed_and_have_types() -> None:
    namespace = {"register": register, "LiveMosaic": LiveMosaic}
    completer: Any = IPCompleter(namespace=namespace, use_jedi=False)  # type: ignore[no-untyped-call]
    for begun, whole in (("register(left, right, effo", "effort="), ("LiveMosaic(canvas", "canvas_limit_px=")):
        with provisionalcompleter():
            assert [each.text for each in completer.completions(begun, len(begun))] == [whole]
    assert STUB.read_text(encoding="utf-8") == describe_keywords(), "run python -m tools.keywords"


def test_a_misspelt_name_and_another_type_are_errors() -> None:
    picture = np.zeros((100, 100), np.uint8)
    with pytest.raises(InputError, match="`effort` is 'fastt'; valid: fast, normal, thorough"):
        register(picture, picture, effort="fastt")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`blending` is 'multiban'"):
        mosaic([picture, picture], MosaicOptions(blending="multiban"))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"options is 'fast'; give RegistrationOptions\(\.\.\.\), or single options"):
        register(picture, picture, "fast")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`scale` is '2'; it must be more than 0"):
        mosaic([picture, picture], scale="2")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`accept_poor` is 'no'; it must be bool"):
        register(picture, picture, accept_poor="no")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"`lens` is 'camera\.toml'; it must be Lens or None"):
        mosaic([picture, picture], lens="camera.toml")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="efforts"):
        register(picture, picture, efforts="fast")  # type: ignore[call-arg]


def test_every_option_has_a_docstring_a_name_and_a_valid_default() -> None:
    chosen = {each.name: set(each.choices) for each in options_of(MosaicOptions)}
    assert chosen["preset"] == set(PRESETS)
    assert chosen["backend"] == set(BACKENDS)
    assert chosen["descriptor"] == {*PATTERNS, *WINDOWS_PX, *descriptors._OPENCV, TRACKED}
    assert chosen["detector"] == {*FRONT_END_DETECTORS, "surf", *detectors._OPENCV}
    assert chosen["estimator"] >= {PROSAC, FABRIC, FUZZY_RANSAC}
    documented = MosaicOptions.__doc__
    assert documented is not None
    for each in options_of(MosaicOptions):
        assert re.search(
            rf"\n    {each.name} : .+, default {re.escape(repr(each.default))}\n        {re.escape(each.help)}",
            documented,
        )
    assert "    damaged : {'refuse', 'keep'}, default 'refuse'\n" in documented
    assert "    scale : float, default 1.0\n" in documented
    MosaicOptions().check_for(2)
    MosaicOptions().check_for(3)
    for each in options_of(MosaicOptions):
        assert each.group in GROUPS
        assert each.help.endswith(".")
        assert each.flags.startswith("--")


@pytest.mark.parametrize(
    ("photographs", "changes", "says"),
    [
        (2, {"preset": "martian"}, "`preset` is 'martian'; valid: aerial, thesis"),
        (2, {"blending": "stirred"}, "`blending` is 'stirred'; valid: average, distance, multiband"),
        (2, {"detector": "freak"}, "freak is a descriptor, no detector; name it as `descriptor`"),
        (2, {"scale": float("nan")}, "it must be more than 0 and at most 1"),
        (2, {"gsd_m": float("inf")}, "`gsd_m` is inf; it must be more than 0"),
        (2, {"gsd_m": 0.1, "scale": 0.5}, "`gsd_m` and `scale` both set the size"),
        (2, {"gsd_m": 0.1}, ""),
        (2, {"repeat": object(), "positions": Positions("geo.txt", ())}, "`positions` and `repeat` both place"),
        (3, {"repeat": object()}, ""),
        (3, {"positions": Positions("geo.txt", ())}, ""),
        (2, {"detector": "sift", "backend": "rtl"}, "leave out `backend`"),
        (2, {"effort": "thorough", "estimator": "magsac"}, "oriented ILBP"),
        (3, {"repeat": object(), "warp": "homography"}, "`repeat` takes over what bends photographs, so `warp`"),
        (2, {"canvas_limit_px": 0}, "it must be at least 1"),
        (2, {"memory_bytes": (64 << 20) - 1}, "it must be at least"),
        (2, {"scale": 0.5, "canvas_limit_px": 1, "memory_bytes": 64 << 20}, ""),
        (1, {}, "at least two photographs, not 1"),
        (2, {"all_groups": True}, "`all_groups`: two photographs make one mosaic; leave it out"),
        (3, {"all_groups": True}, ""),
        (2, {"cache": Path("kept")}, "`cache`: two photographs are registered anew each time; leave it out"),
        (3, {"cache": Path("kept")}, ""),
        (3, {"estimator": "magsac"}, "`estimator` magsac: more than two photographs are linked by prosac"),
        (3, {"effort": "fast"}, "`effort` fast: more than two photographs are linked by one pass each; leave it out"),
        (3, {"accept_poor": True}, "`accept_poor`: "),
        (2, {"accept_poor": True}, ""),
        (3, {"descriptor": "sift"}, "Harris or FAST with ILBP"),
        (2, {"descriptor": "sift"}, ""),
    ],
)
def test_options_apply_or_are_refused_with_the_reason(photographs: int, changes: dict[str, Any], says: str) -> None:
    options = dataclasses.replace(MosaicOptions(), **changes)
    if says:
        with pytest.raises(InputError) as refused:
            options.check_for(photographs)
        assert says in str(refused.value)
    else:
        options.check_for(photographs)
        assert options.flight_settings().lens == changes.get("lens", Lens())
