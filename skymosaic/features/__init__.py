"""Detectors, descriptors and matchers with one interface, computed on the host or by the front end."""
