"""Test benches for blocks and for the ports of whole designs."""
