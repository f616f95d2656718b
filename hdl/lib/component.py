"""Components of which some ports have fixed shapes, and others shapes that parameters decide."""

from typing import Any, ClassVar

from amaranth.lib import wiring


class Component(wiring.Component):
    """A component that declares ports in both ways of Amaranth's own, which takes one of them alone.

    Ports with fixed shapes are annotations, ``i_enable: In(1)``; the others are arguments, ``o=Out(bits)``, and their
    plain annotations say for people and type checkers what they are. The order is that of the annotations.
    """

    _annotations: ClassVar[dict[str, Any]] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls._annotations = {**cls._annotations, **cls.__annotations__}
        # Where Amaranth finds ports here, it takes no others.
        cls.__annotations__ = {}

    def __init__(self, **ports: wiring.Member) -> None:
        declared = {**self._annotations, **ports}
        members = {name: port for name, port in declared.items() if isinstance(port, wiring.Member)}
        # The ports' source is the line that calls this. The stubs do not know the argument.
        super().__init__(members, src_loc_at=1)  # type: ignore[call-arg]
