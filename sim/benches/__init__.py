"""Test benches for blocks."""
