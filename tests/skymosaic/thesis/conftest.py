"""Fixtures: a rendered pair, and every experiment on it."""

import pytest

from skymosaic.thesis.dataset import DatasetPair, list_sources
from skymosaic.thesis.experiments import run_experiments
from skymosaic.thesis.measurements import Measurements


@pytest.fixture(scope="session")
def pair() -> DatasetPair:
    return list_sources(None)[0]()


@pytest.fixture(scope="session")
def measured() -> Measurements:
    """All experiments on the first pair."""
    return run_experiments(list_sources(None)[:1])
