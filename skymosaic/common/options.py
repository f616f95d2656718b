"""What an option is: a dataclass field with the help, the group and the valid values that every interface shows."""

import dataclasses
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Concatenate, ParamSpec, TypeVar

from skymosaic.common.errors import InputError

GROUPS = ("Input", "Registration", "Picture", "Map", "Hardware", "Output", "Machine")
"""Headings in the help, in this order."""
INPUT, REGISTRATION, PICTURE, MAP, HARDWARE, OUTPUT, MACHINE = GROUPS

Class = TypeVar("Class", bound=type[Any])
Default = TypeVar("Default")
About = ParamSpec("About")


@dataclass(frozen=True)
class Option:
    """What an interface has to know of an option.

    Attributes
    ----------
    help : str
        One sentence.
    group : str
        One of `GROUPS`.
    choices : tuple of str
        The names that it takes; empty where it takes no name.
    checked : bool
        Whether `check` refuses other names; otherwise the code that loads what is named does, with its own reason.
    above, minimum, maximum : float or None
        Limits of a number; ``above`` itself is not valid.
    flag : str
        On the command line.
    flag_unit : int
        The command line counts in multiples of this.
    flag_unit_name : str
        What the help on the command line calls them.
    not_for_two, not_for_more : str
        Why it has no effect on two photographs, or on more; empty where it has one.
    name, type, default
        Of the dataclass field, filled in by `options_of`.
    """

    help: str
    group: str = REGISTRATION
    choices: tuple[str, ...] = ()
    checked: bool = True
    above: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    flag: str = ""
    flag_unit: int = 1
    flag_unit_name: str = ""
    not_for_two: str = ""
    not_for_more: str = ""
    name: str = ""
    type: str = ""
    default: Any = None

    @property
    def valid(self) -> str:
        """The valid names, or the limits of a number, in words; empty where there are none."""
        limits = {"more than": self.above, "at least": self.minimum, "at most": self.maximum}
        words = [f"{limit} {number}" for limit, number in limits.items() if number is not None]
        return ", ".join(self.choices) or " and ".join(words)

    def check(self, value: Any, called: str = "") -> None:
        """Raise `InputError` for a name or a number that is not valid; None always is.

        ``called`` is what the message calls the option instead of its name in Python.
        """
        # None stands for a default that depends on other options or on the photographs.
        if value is None or not self.valid or not self.checked:
            return
        if self.choices and value not in self.choices:
            raise InputError(f"{called or self.name} is {value!r}; valid: {self.valid}")
        if not self.choices and not (
            math.isfinite(value)
            and (self.above is None or value > self.above)
            and (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
        ):
            raise InputError(f"{called or self.name} is {value}; it must be {self.valid}")


def _field_of(describe: Callable[About, Option]) -> Callable[Concatenate[Default, About], Default]:
    """Make a dataclass field of a default and what `Option` takes, so that type checkers know the arguments."""

    def describe_field(default: Default, /, *args: About.args, **kwargs: About.kwargs) -> Default:
        described: Default = field(default=default, metadata={"option": describe(*args, **kwargs)})
        return described

    return describe_field


option = _field_of(Option)


def options_of(cls: type[Any]) -> list[Option]:
    """The options of a class, group by group; fields without a description are for programs only."""
    options = []
    for each in dataclasses.fields(cls):
        if about := each.metadata.get("option"):
            # Names in Python end in their unit.
            flag = about.flag or "--" + re.sub("_(px|m|bytes)$", "", each.name).replace("_", "-")
            field_facts = {"name": each.name, "type": str(each.type), "default": each.default}
            options.append(dataclasses.replace(about, flag=flag, **field_facts))
    return sorted(options, key=lambda each: GROUPS.index(each.group))


def document_options(cls: Class) -> Class:
    """Add the options to the docstring of their class, so that ``help`` and notebooks show them."""
    lines = [(cls.__doc__ or "").rstrip(), "", "    Attributes", "    ----------"]
    for each in options_of(cls):
        valid = f" Valid: {each.valid}." if each.valid else ""
        lines += [f"    {each.name} : {each.type}, default {each.default!r}", f"        {each.help}{valid}"]
    cls.__doc__ = "\n".join([*lines, "    "])
    return cls
