"""Elements of our own, each a class here and a component for the browser beside it."""
