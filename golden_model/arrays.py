"""Names for the array types that every package uses.

NumPy's types know the element type but not the shape; these names say which shape is meant.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers of any shape."""
Matrix = NDArray[np.float64]
"""A (3, 3) homography, similarity or camera matrix."""
Points = NDArray[np.float64]
"""Points (N, 2): x to the right and y down, px; pixel centres are integers."""
Float32 = NDArray[np.float32]
"""Single precision, for weights and blended colours: whole images in double precision are too large."""
Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]
"""An image (H, W) gray or (H, W, 3) BGR."""
Intensities = NDArray[np.uint8 | np.uint16]
"""As `Pixels`, but 16 bits where the photographs have 16 bits."""
Records = NDArray[np.void]
"""Feature or match records, see `golden_model.records`."""
