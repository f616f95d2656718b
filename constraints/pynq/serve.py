"""Loads the accelerator and serves it: python3 serve.py [--bitstream FILE].

It runs as root in PYNQ's Python environment; the export's README.md says how to start it.
"""

from pynq_bus import PynqBus
from skymosaic_driver import Accelerator
from skymosaic_server import options_parser, serve

parser = options_parser(__doc__)
parser.add_argument("--bitstream", default="skymosaic.bit")
serve(parser, lambda options: Accelerator(PynqBus(options.bitstream)))
