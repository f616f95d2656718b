"""Photographs to mosaics: options, plan, result and the functions of the API."""
