"""The machinery that runs the work: threads or a cluster, and a cache of results."""
