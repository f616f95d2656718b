"""Loads the camera build, and serves its rings and painter: python3 serve_camera.py --address 0x43C00000.

It runs as root in PYNQ's Python environment. Not yet run on a board.
"""

from ring_bus import RingBus
from skymosaic_camera import PORT
from skymosaic_camera_server import CameraSession
from skymosaic_server import options_parser, serve

parser = options_parser(__doc__, PORT)
parser.add_argument("--bitstream", default="skymosaic_camera.bit")
parser.add_argument("--address", type=lambda text: int(text, 0), required=True, help="of s_axi_ctrl in the design")
serve(parser, lambda options: RingBus(options.bitstream, options.address), CameraSession)
