"""Pages and figures that explain a result."""
