"""Detectors, descriptors and matchers behind one interface, on the host or the front end."""
