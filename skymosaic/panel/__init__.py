"""The front panel: the whole chain as a web page that explains itself."""
