from skymosaic.thesis.measurements import Measurements


def test_every_table_is_measured_on_every_pair(measured: Measurements) -> None:
    assert len(measured.pairs) == 1
    everywhere = {"IV-1", "adaptive", "IV-2", "IV-3", "IV-4", "IV-5", "stages", "figure IV-6"}
    for pair in measured.pairs:
        assert everywhere <= {line.table for line in measured.lines if line.pair == pair}
    assert measured.values("IV-7", "aerial preset", "whole")
