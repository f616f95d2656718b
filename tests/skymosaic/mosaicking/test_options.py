"""The options: keyword arguments are held to the fields, and each option applies or is refused with the reason."""

import dataclasses
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from skymosaic.common.errors import InputError
from skymosaic.common.options import GROUPS, options_of
from skymosaic.mosaicking.options import MosaicKeywords, MosaicOptions
from skymosaic.registration.options import FeatureKeywords, FeatureOptions, RegistrationKeywords, RegistrationOptions


@pytest.mark.parametrize(
    ("keywords", "options"),
    [(FeatureKeywords, FeatureOptions), (RegistrationKeywords, RegistrationOptions), (MosaicKeywords, MosaicOptions)],
)
def test_keyword_arguments_have_the_names_and_types_of_the_fields(keywords: type, options: type) -> None:
    names = {field.name for field in dataclasses.fields(options)}
    types = get_type_hints(options)
    assert get_type_hints(keywords) == {name: types[name] for name in names}


def test_the_docstring_has_every_option() -> None:
    documented = MosaicOptions.__doc__
    assert documented is not None
    for each in options_of(MosaicOptions):
        assert f"    {each.name} : {each.type}, default {each.default!r}\n        {each.help}" in documented


def test_every_default_is_valid_and_every_sentence_ends() -> None:
    MosaicOptions().check_for(2)
    MosaicOptions().check_for(3)
    for each in options_of(MosaicOptions):
        assert each.group in GROUPS
        assert each.help.endswith(".")
        assert each.flag.startswith("--")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"preset": "martian"}, "preset is 'martian'; valid: aerial, thesis"),
        ({"blending": "stirred"}, "blending is 'stirred'; valid: average, distance, multiband"),
        ({"detector": "freak"}, "freak is a descriptor"),
        ({"scale": 0.0}, "scale is 0.0; it must be more than 0 and at most 1"),
        ({"scale": float("nan")}, "it must be more than 0 and at most 1"),
        ({"gsd_m": float("inf")}, "gsd_m is inf; it must be more than 0"),
        ({"seed": -1}, "seed is -1; it must be at least 0"),
        ({"working_width_px": 63}, "it must be at least 64 and at most 4096"),
        ({"gsd_m": 0.1, "scale": 0.5}, "gsd and scale both set the size"),
        ({"layout": object(), "positions": object()}, "positions and layout both place the photographs"),
        ({"detector": "sift", "backend": "rtl"}, "leave out --backend"),
        ({"effort": "thorough", "estimator": "magsac"}, "oriented ILBP"),
    ],
)
def test_what_is_not_valid_is_refused_with_what_is(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError) as refused:
        dataclasses.replace(MosaicOptions(), **changes).check_for(2)
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("photographs", "changes", "says"),
    [
        (1, {}, "at least two photographs, not 1"),
        (2, {"all_groups": True}, "all_groups: two photographs make one mosaic; leave out --all-groups"),
        (2, {"cache": Path("kept")}, "cache: two photographs are registered anew each time; leave out --cache"),
        (3, {"estimator": "magsac"}, "estimator magsac: more than two photographs are linked by prosac"),
        (3, {"effort": "fast"}, "leave out --effort, or keep only two photographs"),
        (3, {"warp": "mesh"}, "leave out --warp"),
        (3, {"refine": True}, "leave out --refine"),
        (3, {"descriptor": "sift"}, "Harris or FAST with ILBP"),
    ],
)
def test_what_has_no_effect_on_so_many_photographs_is_refused(
    photographs: int, changes: dict[str, Any], says: str
) -> None:
    options = dataclasses.replace(MosaicOptions(), **changes)
    with pytest.raises(InputError) as refused:
        options.check_for(photographs)
    assert says in str(refused.value)
    if photographs > 1:
        options.check_for(5 - photographs)
