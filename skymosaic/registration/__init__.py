"""Two photographs to one homography: search passes, estimation, confidence."""
