"""The homography of each frame, estimated from its matches, in the integers of the hardware."""
