"""The pages: what is built when a browser opens one, and how it follows its session."""
