"""Prints by Rich, whose import takes longer than all that ``skymosaic --version`` does."""

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console, RenderableType
from rich.text import Text

from golden_model.text import one_line
from skymosaic.common.options import respell

PIPED_WIDTH = 1000
"""Columns of a table that is not read on a terminal, where nothing should be wrapped."""


class Terminal(Console):
    """Without Rich's answer to a closed pipe, which ends the program with 1 and discards standard output."""

    def on_broken_pipe(self) -> None:
        """Leave it to whoever prints: a closed standard error must not cost the user the mosaic."""
        raise BrokenPipeError

    def print_line(self, line: str, style: str = "") -> None:
        """Print a message on one line; options that it names become flags."""
        # A closed standard error must not cost the user the mosaic.
        with contextlib.suppress(OSError):
            self.print(one_line(respell(line)), style=style, markup=False, highlight=False, soft_wrap=True)

    def show(self, result: RenderableType) -> None:
        """Print a line of text or a table."""
        console = self if self.is_terminal else Terminal(stderr=self.stderr, width=PIPED_WIDTH)
        # Names of files are not Rich's markup, and stay on one line.
        text = Text(one_line(result)) if isinstance(result, str) else result
        console.print(text, highlight=False, soft_wrap=isinstance(result, str))
        # Where both go to one file, results and progress stay in order.
        console.file.flush()

    @contextlib.contextmanager
    def working(self, stage: str) -> Iterator[Callable[[str], None]]:
        """Context of a moving display; the callable that it yields shows what is being done."""
        with self.status(Text(stage)) as status:
            yield lambda line: status.update(Text(f"{stage}: {one_line(line)}"))
