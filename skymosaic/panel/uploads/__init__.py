"""Files from browsers: received, checked, decoded, and kept within limits."""
