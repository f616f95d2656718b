"""The version of everything: package, registers, exported cores and drivers. The package's metadata is read from it."""

VERSION = "0.2.0"
"""major.minor.patch, three numbers below 256, as the register VERSION holds them."""
