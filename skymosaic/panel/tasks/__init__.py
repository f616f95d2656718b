"""Long tasks and the processes they run in."""
