import json
from pathlib import Path

import numpy as np

from skymosaic.maps.features import Place, write_places


def test_an_outline_across_180_degrees_does_not_run_around_the_globe(tmp_path: Path) -> None:
    ring = np.array([[179.999, -16.5], [-179.999, -16.5], [-179.999, -16.4], [179.999, -16.4], [179.999, -16.5]])
    write_places(tmp_path / "a.geojson", "flight", [Place("a.jpg", "Polygon", ring)])
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    (written,) = feature["geometry"]["coordinates"]
    assert [longitude for longitude, _ in written] == [179.999, 180.001, 180.001, 179.999, 179.999]
    assert [latitude for _, latitude in written] == [-16.5, -16.5, -16.4, -16.4, -16.5]
