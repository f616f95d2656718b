"""Loads the accelerator and serves it: python3 serve.py [--bitstream FILE] [--host HOST --key FILE].

It runs as root in PYNQ's Python environment; the export's README.md says how to start it.

Without --host, only programs on the board itself (or an SSH tunnel) reach the server. With another host, a key is
needed: a file of at least 16 bytes, of which each client has a copy (python3 -c "import secrets;
print(secrets.token_hex())" > key).
"""

import argparse
import pathlib

from pynq_bus import PynqBus
from skymosaic_driver import Accelerator
from skymosaic_server import Server

PORT = 7020
SHORTEST_KEY_BYTES = 16

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--bitstream", default="skymosaic.bit")
parser.add_argument("--host", default="127.0.0.1", help="address to listen on; 0.0.0.0: all")
parser.add_argument("--port", type=int, default=PORT)
parser.add_argument("--key", type=pathlib.Path, help="file with the key that clients must know")
options = parser.parse_args()
key = options.key.read_bytes().strip() if options.key else None
if key is not None and len(key) < SHORTEST_KEY_BYTES:
    parser.error(f"{options.key} has less than {SHORTEST_KEY_BYTES} bytes")
try:
    server = Server((options.host, options.port), Accelerator(PynqBus(options.bitstream)), key)
except ValueError as error:
    parser.error(str(error))
with server:
    print(f"serving on {options.host}:{options.port}")
    server.serve_forever()
