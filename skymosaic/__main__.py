"""``python -m skymosaic``."""

from skymosaic.cli import main

main()
