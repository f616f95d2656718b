"""Native Yosys as a command, with the options that benches, proofs and SymbiYosys give it: ``-q -p COMMANDS`` or
``-ql LOG SCRIPT``.

It comes as a library, pyosys. The same Yosys in WebAssembly compiles itself at its first start, in two minutes of a
processor.
"""

import argparse
import importlib
import os
import sys
from importlib.metadata import distribution
from pathlib import Path

YOSYS = (sys.executable, str(Path(__file__).resolve()))
ABC = Path(str(distribution("pyosys").locate_file("pyosys/yosys-abc")))
SHARE = ABC.with_name("share")
"""Models of cells, in the Verilog that Yosys reads."""


def main() -> None:
    """Run the commands; an error ends the process with Yosys's own words and status 1."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-q", action="store_true", required=True, help="print nothing but errors")
    parser.add_argument("-l", metavar="LOG", help="write the messages there")
    parser.add_argument("-p", metavar="COMMANDS", help="separated by semicolons")
    parser.add_argument("script", nargs="?")
    options = parser.parse_args()
    # In a process of its own: libraries of C++ that are imported behind it, as PROJ, abort.
    libyosys = importlib.import_module("pyosys.libyosys")
    # Its own `tee -q` leaves some messages, and changes what follows: a path of 6 cells in place of 5 (measured).
    with Path(options.l or os.devnull).open("w") as log:
        os.dup2(log.fileno(), sys.stdout.fileno())
    for command in options.p.split(";") if options.p else [f"script {options.script}"]:
        libyosys.run_pass(command.strip())


if __name__ == "__main__":
    main()
