"""The command that registers a pair of photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import (
    AddressOption,
    BackendOption,
    ConfigOption,
    DamagedOption,
    DescriptorOption,
    DetectorOption,
    EffortOption,
    EstimatorOption,
    PresetOption,
    RefineOption,
    SeedOption,
    WorkingWidthOption,
    backend_at,
    configuration,
    print_pair,
)
from skymosaic.cli.session import session
from skymosaic.errors import RegistrationError
from skymosaic.registration.register import WORKING_WIDTH_PX
from skymosaic.registration.register import register as register_pair


def register(
    *,
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    preset: PresetOption = "aerial",
    detector: DetectorOption = None,
    descriptor: DescriptorOption = None,
    estimator: EstimatorOption = "prosac",
    effort: EffortOption = None,
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
    refine: RefineOption = False,
    damaged: DamagedOption = "refuse",
) -> None:
    """Print the homography that maps LEFT pixels to RIGHT pixels, and how it was found."""
    with session.working("registering") as step:
        pair = register_pair(
            left,
            right,
            config=configuration(preset, config),
            detector=detector,
            descriptor=descriptor,
            estimator=estimator,
            effort=effort,
            backend=backend_at(backend, address),
            seed=seed,
            working_width_px=working_width_px,
            refine=refine,
            damaged=damaged,
            progress=step,
        )
        session.numbers = pair.summary()
    session.seconds = pair.seconds
    if pair.homography is not None:
        print_pair(pair)
        for row in pair.homography:
            session.show("  ".join(f"{value: .9e}" for value in row))
    if not pair.accepted:
        raise RegistrationError(f"{left} and {right} cannot be registered: {pair.reason}")
