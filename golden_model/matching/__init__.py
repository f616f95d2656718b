"""Descriptor and window matching, and the fuzzy rules that weigh each match."""
