import pytest

from skymosaic.thesis import page, pictures
from skymosaic.thesis.dataset import DatasetPair
from skymosaic.thesis.experiments import find_best_pair
from skymosaic.thesis.measurements import Measurements


@pytest.mark.slow
def test_the_page_has_every_table_and_stands_alone(measured: Measurements, pair: DatasetPair) -> None:
    shown = list(pictures.draw_pair(pair))
    text = page.compose_page(measured, "a <rendered> flight", shown, pair.name).decode()
    for number in range(1, 8):
        assert f"Table IV-{number}" in text
    assert "Figure IV-6" in text
    assert "a &lt;rendered&gt; flight" in text
    assert 'src="http' not in text
    assert text.count("data:image/svg+xml") == 7
    assert text.count("data:image/jpeg") == len(shown) == 7
    assert find_best_pair(measured) == 0
