"""Steady video of a camera that moves: where each of its frames lies in a picture that follows a smooth path.

Needs Python 3.10 and numpy; `skymosaic_painter.Painter` uses it.
"""

import numpy as np

MARGIN_PX = 1
"""The picture stays so far inside the frame: nothing black is seen where poses are rounded."""
HALVINGS = 12


class SteadyPath:
    """A view without weight that follows the camera's, and never leaves what that sees.

    From frame to frame the view moves on as before, and is then drawn to the middle of the frame, by a critically
    damped g-h filter (Brookner, Tracking and Kalman Filtering Made Easy, 1998), which is made as much stiffer as keeps
    its corners in the frame. It knows homographies from frame to frame alone, so errors do not add up.

    Parameters
    ----------
    frame, picture : (int, int)
        Width and height of the camera's frames and of the picture, in px.
    crop : float
        Share of a frame's width and height that the picture leaves out, so that their paths may differ: 0 to 0.5.
    smooth_frames : float
        Number of frames in which a deviation falls to about a third; at least 1.
    """

    def __init__(self, frame, picture, *, crop=0.1, smooth_frames=20):
        if not (0 < crop <= 0.5 and smooth_frames >= 1):
            raise ValueError(f"crop is {crop}, smooth_frames {smooth_frames}; they are 0 to 0.5, and at least 1")
        frame, picture = np.asarray(frame), np.asarray(picture)
        half = (picture - 1) / 2
        # Inside, the picture's coordinates begin in its middle.
        self._shift = np.array([[1, 0, -half[0]], [0, 1, -half[1]], [0, 0, 1]])
        self._corners = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, 1, 1, 1]]) * [[half[0]], [half[1]], [1]]
        self._middle = np.diag([*np.full(2, (1 - crop) * (frame / picture).min()), 1.0])
        self._middle[:2, 2] = (frame - 1) / 2
        self._farthest = frame[:, np.newaxis] - 1 - MARGIN_PX
        self._max_gap, self._share = smooth_frames, 1 - np.exp(-2 / smooth_frames)
        self.begin()

    def begin(self):
        """Forget all frames."""
        self._newest, self._pose, self._motion = None, self._middle, np.eye(3)

    def follow(self, number, reference, link):
        """Return where a frame lies: the homography from pixels of the picture to its own, (3, 3).

        ``link`` is the homography from the frame ``reference``. Where that is not the one before, or is long past, a
        path begins anew.
        """
        if reference != self._newest or number - reference > self._max_gap:
            self.begin()
        else:
            ahead = link @ self._pose @ np.linalg.matrix_power(self._motion, number - reference)
            back = np.linalg.inv(ahead) @ self._middle
            share = self._least_share(ahead, back)
            self._pose = ahead @ part(back, share)
            self._pose /= self._pose[2, 2]
            self._motion = self._motion @ part(back, (1 - np.sqrt(1 - share)) ** 2)
        self._newest = number
        return self._pose @ self._shift

    def _least_share(self, ahead, back):
        """Find how much of the way back to the middle the view must go."""
        if self._is_inside(ahead @ part(back, self._share)):
            return self._share
        low, high = self._share, 1.0
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if self._is_inside(ahead @ part(back, middle)) else (middle, high)
        return high

    def _is_inside(self, pose):
        *positions, w = pose @ self._corners
        positions = positions / w
        return bool((w > 0).all() and (positions >= MARGIN_PX).all() and (positions <= self._farthest).all())


def part(motion, share):
    """Go a share of a small motion, (3, 3), to first order."""
    return np.eye(3) + share * (motion / motion[2, 2] - np.eye(3))
