"""What files of numbers say of themselves."""

import json
import math
from pathlib import Path

from golden_model.version import VERSION
from skymosaic.common.provenance import finite, provenance, to_json


def test_what_json_does_not_know_is_null_or_text() -> None:
    nested = {"a": (1.5, math.inf, [-math.inf, {"b": math.nan}]), Path("c"): [Path("d"), None, True, 7]}
    assert finite(nested) == {"a": [1.5, None, [None, {"b": None}]], "c": ["d", None, True, 7]}


def test_a_file_says_what_wrote_it_and_is_json() -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    read = json.loads(to_json({"written": "by hand", "error_px": math.nan}), parse_constant=refuse)
    assert read == {**provenance(), "written": "by hand", "error_px": None}
    assert (read["program"], read["version"]) == ("skymosaic", VERSION)
