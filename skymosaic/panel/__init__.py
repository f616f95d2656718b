"""The front panel: a web page that makes mosaics, tracks objects and explains the results."""
