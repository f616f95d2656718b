"""Serves the accelerator behind a serial port: python3 serve_serial.py /dev/ttyUSB0.

It needs numpy and pyserial.
"""

import serial
from serial_bus import BAUD, TIMEOUT_SECONDS, SerialBus
from skymosaic_driver import Accelerator
from skymosaic_server import options_parser, serve

# Longer than the default of the driver, because the serial port is slow.
FRAME_SECONDS = 20.0

parser = options_parser(__doc__)
parser.add_argument("device", help="serial port of the board, such as /dev/ttyUSB0")
serve(
    parser,
    lambda options: Accelerator(
        SerialBus(serial.Serial(options.device, BAUD, timeout=TIMEOUT_SECONDS)), timeout_seconds=FRAME_SECONDS
    ),
)
