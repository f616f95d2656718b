"""What an option is: a dataclass field that says all that Python, the command line and the panel have to know of it."""

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from skymosaic.common.errors import InputError

GROUPS = ("Input", "Registration", "Picture", "Map", "Hardware", "Output", "Machine")
"""Headings in the help, in this order."""
INPUT, REGISTRATION, PICTURE, MAP, HARDWARE, OUTPUT, MACHINE = GROUPS

Class = TypeVar("Class", bound=type[Any])
Function = TypeVar("Function", bound=Callable[..., Any])
Default = TypeVar("Default")
Chosen = TypeVar("Chosen", bound="Checked")


_NUMBERS = {int: Integral, float: Real}
"""Types of options whose values may have NumPy's."""


@dataclass(frozen=True)
class Option:
    """What an interface has to know of an option."""

    help: str
    """One sentence; other options stand in it in backquotes."""
    group: str = REGISTRATION
    """One of `GROUPS`."""
    label: str = ""
    """In the panel; empty where the panel does not have it."""
    above: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    """Limits of a number; ``above`` itself is not valid."""
    unit: int = 1
    unit_name: str = ""
    """The command line counts in multiples of this; what the help there calls them."""
    read: Callable[..., Any] | None = None
    """Makes the value of what is typed on the command line: a file, or a name."""
    read_with: tuple[str, ...] = ()
    """Other options whose typed values ``read`` takes after it."""
    parts: Mapping[str, str] = field(default_factory=dict)
    """What is typed instead, with a sentence each, where ``read`` makes one value of several files."""
    not_for_two: str = ""
    not_for_more: str = ""
    """Why it has no effect on two photographs, or on more; empty where it has one."""
    name: str = ""
    type: Any = None
    default: Any = None
    """Those of the dataclass field, filled in by `options_of`."""

    @property
    def choices(self) -> tuple[str, ...]:
        """The names that it takes; empty where it takes no name."""
        return tuple(name for each in _members(self.type) if get_origin(each) is Literal for name in get_args(each))

    @property
    def valid(self) -> str:
        """The valid names, or the limits of a number, in words; empty where there are none."""
        limits = {"more than": self.above, "at least": self.minimum, "at most": self.maximum}
        words = [f"{limit} {number}" for limit, number in limits.items() if number is not None]
        return ", ".join(self.choices) or " and ".join(words)

    @property
    def flags(self) -> str:
        """What it is called on the command line."""
        return " or ".join(map(flag_of, self.parts or [self.name]))

    def check(self, value: Any) -> None:
        """Raise `InputError` for another type, or a name or a number that is not valid; None always is."""
        # None stands for a default that depends on other options or on the photographs.
        if value is not None and not self._takes(value):
            valid = f"valid: {self.valid}" if self.choices else f"it must be {self.valid or _spell_type(self.type)}"
            raise InputError(f"`{self.name}` is {value!r}; {valid}")

    def _takes(self, value: Any) -> bool:
        if self.choices and isinstance(value, str):
            return value in self.choices
        # Beside names, objects stand for themselves.
        classes: Any = tuple(_NUMBERS.get(each, each) for each in _members(self.type) if isinstance(each, type))
        if not isinstance(value, classes):
            return False
        if self.choices or not self.valid:
            return True
        return (
            math.isfinite(value)
            and (self.above is None or value > self.above)
            and (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
        )


def _members(annotation: Any) -> tuple[Any, ...]:
    """A type, and the types of which it is the union."""
    return (annotation, *get_args(annotation))


def option(default: Default, *about: Any, **details: Any) -> Default:
    """A dataclass field with a default, and what `Option` takes beside the field's own name and type."""
    described: Default = field(default=default, metadata={"option": Option(*about, **details)})
    return described


def options_of(cls: type[Any]) -> list[Option]:
    """The options of a class, group by group; fields without a description are for programs only."""
    types = get_type_hints(cls)
    options = [
        dataclasses.replace(about, name=each.name, type=types[each.name], default=each.default)
        for each in dataclasses.fields(cls)
        if (about := each.metadata.get("option"))
    ]
    return sorted(options, key=lambda each: GROUPS.index(each.group))


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A base of objects of options."""

    def check(self) -> None:
        """Refuse what is not valid.

        Raises
        ------
        InputError
            For an unknown name, an impossible value or an impossible combination; the message is one line.
        """
        for each in options_of(type(self)):
            each.check(getattr(self, each.name))


def choose_options(cls: type[Chosen], options: Chosen | None, changes: Mapping[str, Any]) -> Chosen:
    """The options that a function was given: an object, and single ones, which take precedence.

    Raises
    ------
    InputError
        For another object.
    """
    if options is not None and not isinstance(options, cls):
        raise InputError(f"options is {options!r}; give {cls.__name__}(...), or single options by their names")
    return dataclasses.replace(options or cls(), **changes)


def flag_of(name: str) -> str:
    """What the command line calls an option: names in Python end in their unit, flags do not."""
    return "--" + re.sub("_(px|m|bytes)$", "", name).replace("_", "-")


def respell(message: str, spell: Callable[[str], str] = flag_of) -> str:
    """A message with its names in backquotes, which are those of Python, as the command line or another spells them."""
    return re.sub(r"`(\w+)`", lambda found: spell(found[1]), message)


def command_words(options: Any, files: Mapping[str, str] | None = None) -> list[str]:
    """What is typed on the command line for options; what has its default needs no word.

    Parameters
    ----------
    options : object
        Of a class with options.
    files : mapping of str to str
        The file of each value that the command line reads from one, by the name of the option.
    """
    words = []
    for each in options_of(type(options)):
        value = getattr(options, each.name)
        if value == each.default:
            continue
        if each.read and not isinstance(value, str):
            value = (files or {})[each.name]
        elif each.unit > 1:
            value //= each.unit
        words += [each.flags] if value is True else [each.flags, str(value)]
    return words


def document_options(cls: Class) -> Class:
    """Add the options to the docstring of their class, so that ``help`` and notebooks show them."""
    lines = [(cls.__doc__ or "").rstrip(), "", "    Attributes", "    ----------"]
    for each in options_of(cls):
        valid = f" It must be {each.valid}." if each.valid and not each.choices else ""
        lines += [
            f"    {each.name} : {_spell_type(each.type)}, default {each.default!r}",
            f"        {each.help}{valid}",
        ]
    cls.__doc__ = "\n".join([*lines, "    "])
    return cls


def _spell_type(annotation: Any) -> str:
    """A type as docstrings spell it."""
    if get_origin(annotation) is Literal:
        return f"{{{', '.join(map(repr, get_args(annotation)))}}}"
    if members := get_args(annotation):
        return " or ".join(map(_spell_type, members))
    return "None" if annotation is type(None) else str(annotation.__name__)


def list_options(function: Function) -> Function:
    """Give a function with a parameter ``options``, and single ones as ``**changes``, a signature that has them all.

    ``help`` and the completion of notebooks read it. Type checkers read `skymosaic.keywords`.
    """
    signature = inspect.signature(function)
    cls = get_args(signature.parameters["options"].annotation)[0]
    types = get_type_hints(cls)
    parameters = [each for each in signature.parameters.values() if each.kind is not each.VAR_KEYWORD]
    parameters += [
        inspect.Parameter(each.name, inspect.Parameter.KEYWORD_ONLY, default=each.default, annotation=types[each.name])
        for each in dataclasses.fields(cls)
    ]
    vars(function)["__signature__"] = signature.replace(parameters=parameters)
    return function
