"""The figures published in chapter IV of the thesis, in the form of our measurements."""

from collections.abc import Iterator

from skymosaic.thesis.measurements import Measurement, Measurements


def _read(table: str, columns: tuple[str, ...], *rows: tuple[str | float, ...]) -> Iterator[Measurement]:
    for setting, *figures in rows:
        values = dict(zip(columns, map(float, figures), strict=True))
        yield Measurement(table, str(setting), pair="", group="", values=values)


PUBLISHED = Measurements([
    # 390x420 px, by threshold of the Harris measure: corners of both images, and their mean.
    *_read("IV-1", ("left", "right", "both"), (5000, 358, 239, 298.5), (4000, 411, 484, 447.5), (3000, 583, 605, 594),
           (2000, 680, 682, 681), (1000, 722, 730, 726), (500, 726, 734, 730), (250, 728, 734, 731)),
    # By side of the SAD window, px.
    *_read("IV-2", ("good", "seconds"), (3, 3, 0.6028), (10, 8, 0.6722), (22, 11, 0.9019), (25, 26, 1.0188),
           (30, 24, 1.3903)),
    # By rings of the ILBP.
    *_read("IV-3", ("bits", "matches", "good", "seconds"), (1, 8, 101, 3, 0.1029), (2, 16, 87, 13, 0.3266),
           (3, 24, 64, 19, 0.7088), (4, 32, 51, 23, 1.201)),
    *_read("IV-4", ("features 1", "features 2", "matched", "bidirectional", "RANSAC", "inliers"),
           ("scene 1", 257, 268, 110, 102, 93, 83), ("scene 2", 321, 293, 141, 130, 116, 105),
           ("scene 3", 403, 306, 162, 129, 148, 116), ("test 1", 206, 199, 65, 59, 55, 50),
           ("test 2", 189, 152, 91, 80, 74, 67)),
    *_read("IV-5", ("RMSE",), ("literature", 1.9), ("literature", 1.8), ("scenes", 1.2), ("scenes", 1.4),
           ("scenes", 1.5), ("tests", 0.39), ("tests", 0.80)),
    # For scenes and tests, these are inliers divided by matched of Table IV-4.
    *_read("IV-6", ("recall",), ("literature", 0.62), ("literature", 0.71), ("literature", 0.27), ("literature", 0.60),
           ("scenes", 0.76), ("scenes", 0.75), ("scenes", 0.72), ("tests", 0.77), ("tests", 0.74)),
    # The whole mosaic, in MATLAB on an i7 with 4 GB.
    *_read("IV-7", ("whole",), ("literature, 408x336", 4.10), ("literature, 381x334", 4.64),
           ("scene 1, 420x520", 2.98), ("scene 2, 390x420", 2.66), ("scene 3, 390x420", 3.22),
           ("test 1, 480x570", 3.17), ("test 2, 620x430", 3.09)),
])  # fmt: skip
"""Tables IV-1 to IV-7."""
