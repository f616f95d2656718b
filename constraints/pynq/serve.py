"""Loads the accelerator and serves it: sudo -E python3 serve.py [--bitstream FILE] [--host HOST] [--port PORT]."""

import argparse

from pynq_bus import PynqBus
from skymosaic_driver import Accelerator
from skymosaic_server import Server

PORT = 7020

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--bitstream", default="skymosaic.bit")
parser.add_argument("--host", default="0.0.0.0")
parser.add_argument("--port", type=int, default=PORT)
options = parser.parse_args()
with Server((options.host, options.port), Accelerator(PynqBus(options.bitstream))) as server:
    print(f"serving on {options.host}:{options.port}")
    server.serve_forever()
