"""What an option takes, and how it is spelt in Python, in help and on the command line."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.common.options import Checked, choose_options, command_words, document_options, option, options_of


@document_options
@dataclass(frozen=True, kw_only=True)
class Options(Checked):
    """Some options."""

    share: float | None = option(None, "A share.", above=0, maximum=1)
    tiles: int = option(2, "Tiles.", minimum=1, maximum=8)
    kind: Literal["plain", "odd"] | bytes = option("plain", "A kind.")
    name: str | None = option(None, "A name.", "Output")
    strict: bool = option(False, "Strict.")
    room_bytes: int = option(1 << 20, "Room.", "Input", unit=1 << 20, unit_name="megabytes")
    private: int = 3


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        *(({"share": each}, "") for each in (None, 1e-9, 1, 1.0, np.float32(0.5))),
        *(({"share": each}, "; it must be more than 0 and at most 1") for each in (0, 1.1, np.inf, np.nan, "1")),
        *(({"tiles": each}, "") for each in (1, 8, np.int16(3))),
        *(({"tiles": each}, "; it must be at least 1 and at most 8") for each in (0, 9, 2.0, "2")),
        *(({"kind": each}, "") for each in ("odd", b"own")),
        *(({"kind": each}, "; valid: plain, odd") for each in ("even", 1)),
        ({"name": 3}, "`name` is 3; it must be str or None"),
        ({"strict": 0}, "`strict` is 0; it must be bool"),
        ({"name": "x", "strict": True}, ""),
    ],
)
def test_an_option_takes_what_is_valid(given: dict[str, Any], fault: str) -> None:
    options = choose_options(Options, Options(tiles=3), given)
    if fault:
        with pytest.raises(InputError, match=f"{fault}$"):
            options.check()
    else:
        options.check()
        assert options == Options(**{"tiles": 3, **given})


def test_options_are_those_of_their_class() -> None:
    assert [each.name for each in options_of(Options)] == ["room_bytes", "share", "tiles", "kind", "strict", "name"]
    assert choose_options(Options, None, {"tiles": 5}) == Options(tiles=5)
    with pytest.raises(InputError, match=r"^options is 3; give Options\(\.\.\.\), or single options by their names$"):
        choose_options(Options, 3, {})  # type: ignore[arg-type]


def test_the_words_for_options_are_those_of_the_command_line() -> None:
    given = Options(share=0.5, kind="odd", strict=True, room_bytes=5 << 20)
    assert command_words(given) == ["--room", "5", "--share", "0.5", "--kind", "odd", "--strict"]


def test_the_docstring_says_what_is_valid() -> None:
    lines = (Options.__doc__ or "").splitlines()
    assert lines[:5] == ["Some options.", "", "    Attributes", "    ----------", lines[4]]
    assert lines[6:12] == [
        "    share : float or None, default None",
        "        A share. It must be more than 0 and at most 1.",
        "    tiles : int, default 2",
        "        Tiles. It must be at least 1 and at most 8.",
        "    kind : {'plain', 'odd'} or bytes, default 'plain'",
        "        A kind.",
    ]
