import dataclasses

from golden_model.config import PRESETS, EstimatorConfig
from golden_model.painting.pose import MAX_LINKS, PoseCause
from golden_model.painting.tiles import MAX_TILES
from hdl.build import BUILDS
from hdl.registers.painter_register_map import PAINTER_REGISTERS, PainterFault
from hdl.registers.register_map import Access
from sim.benches.exported import host_programs

FIELDS = {field.name: field for register in PAINTER_REGISTERS for field in register.fields}


def test_fields_hold_the_largest_values_of_model_and_hardware() -> None:
    bits = {
        "canvas_columns": MAX_TILES.bit_length(),
        "canvas_rows": MAX_TILES.bit_length(),
        "painter_max_links": MAX_LINKS.bit_length(),
        "pose_causes": len(PoseCause),
        "pose_answer": len(PoseCause),
        "painter_refused": len(PainterFault),
    }
    assert {name: FIELDS[name].bits >= most for name, most in bits.items()} == dict.fromkeys(bits, True)


def test_what_the_exported_driver_counts_is_there_to_be_read() -> None:
    config = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig())
    with host_programs(dataclasses.replace(BUILDS["camera"], config=config, painter=True)) as load:
        counters = load("skymosaic_painter").COUNTERS
    assert {FIELDS[name].access for name in counters} == {Access.STATUS}
    counted = {f"{part}_{each}" for part in ("frames", "tiles") for each in ("cut", "lost", "skipped", "unplaced")}
    assert counted & FIELDS.keys() <= set(counters)
