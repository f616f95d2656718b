from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.matches import measure_rings, measure_windows


def test_good_and_false_matches_are_the_stages_input(pair: DatasetPair) -> None:
    lines = [*measure_windows(pair), *measure_rings(pair)]
    counts = [values for table, _, values in lines if table != "stages"]
    stages = [values for table, _, values in lines if table == "stages"]
    for before, after in zip(counts, stages, strict=True):
        assert after["TP"] + after["FN"] == before["good"]
        assert after["TP"] + after["FP"] + after["TN"] + after["FN"] == before["matches"]
