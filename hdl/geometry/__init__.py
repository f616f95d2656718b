"""The homography of each frame, estimated from its matches: search, refit and acceptance."""
