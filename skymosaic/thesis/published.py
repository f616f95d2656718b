"""The figures published in chapter IV of the thesis."""

CORNERS = {
    5000: (358, 239), 4000: (411, 484), 3000: (583, 605), 2000: (680, 682), 1000: (722, 730), 500: (726, 734),
    250: (728, 734),
}  # fmt: skip
"""Table IV-1: corners of image 1 and image 2 (390x420), by threshold of the Harris measure."""

CORRELATION = {3: (3, 0.6028), 10: (8, 0.6722), 22: (11, 0.9019), 25: (26, 1.0188), 30: (24, 1.3903)}
"""Table IV-2: good matches and seconds, by side of the SAD window in px."""

ILBP = {1: (101, 3, 0.1029), 2: (87, 13, 0.3266), 3: (64, 19, 0.7088), 4: (51, 23, 1.201)}
"""Table IV-3: matches, good matches and seconds, by rings of the ILBP."""

FUZZY_RANSAC = {
    "scene 1": (257, 268, 110, 102, 93, 83),
    "scene 2": (321, 293, 141, 130, 116, 105),
    "scene 3": (403, 306, 162, 129, 148, 116),
    "test 1": (206, 199, 65, 59, 55, 50),
    "test 2": (189, 152, 91, 80, 74, 67),
}
"""Table IV-4: features of image 1 and of image 2, matched, bidirectional, RANSAC, inliers."""

RMSE_PX = {"literature": (1.9, 1.8), "scenes": (1.2, 1.4, 1.5), "tests": (0.39, 0.80)}
"""Table IV-5: RMSE of the inliers."""

RECALL = {"literature": (0.62, 0.71, 0.27, 0.60), "scenes": (0.76, 0.75, 0.72), "tests": (0.77, 0.74)}
"""Table IV-6; for scenes and tests, these are inliers divided by matched of Table IV-4."""

MOSAIC_SECONDS = {
    "literature, 408x336": 4.10,
    "literature, 381x334": 4.64,
    "scene 1, 420x520": 2.98,
    "scene 2, 390x420": 2.66,
    "scene 3, 390x420": 3.22,
    "test 1, 480x570": 3.17,
    "test 2, 620x430": 3.09,
}
"""Table IV-7: seconds for the whole mosaic, in MATLAB on an i7 with 4 GB."""
