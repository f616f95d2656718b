"""The programs of the estimator, as the hardware's read-only memory holds them."""

from golden_model.geometry.program import LANES, Coordinate, Program, Value, constants, held, loaded, schedule
from golden_model.geometry.refit import SUMS, factors, solve_sums
from golden_model.geometry.sampling import SAMPLE
from golden_model.geometry.solving import areas, solve

LEFT = (Coordinate.LEFT_X, Coordinate.LEFT_Y)
RIGHT = (Coordinate.RIGHT_X, Coordinate.RIGHT_Y)
CENTRE = (Coordinate.CENTRE_X, Coordinate.CENTRE_Y)
GROUP = 4
"""Matches that `ADD` takes, in slots 0 to 3."""
ELEMENTS = 9
AREAS_KEPT = 7
"""Three left and four right areas of a lane's sample, which `AREAS` leaves for `SOLVE`."""
FIRST_SUM = 2
FIRST_ELEMENT, LANE_REGISTERS = 32, 16
"""Where each lane's homography is left; leading bits of the address select the lane."""
FIRST_FREE = FIRST_ELEMENT + LANE_REGISTERS * LANES


def _areas() -> Program:
    results: list[tuple[int, Value]] = []
    checks: list[tuple[int, Value]] = []
    for lane in range(LANES):
        (left_areas, right_areas), products = areas(*constants(), _sample(lane))
        results += enumerate([*left_areas[:3], *right_areas], _first_area(lane))
        checks += [(lane, each) for each in products]
    return schedule(results, checks, first=FIRST_FREE)


def _solve() -> Program:
    results: list[tuple[int, Value]] = []
    for lane in range(LANES):
        kept = [held(_first_area(lane) + n) for n in range(AREAS_KEPT)]
        results += _elements(solve(*constants(), _sample(lane), (kept[:3], kept[3:])), lane)
    return schedule(results, first=FIRST_FREE)


def _sample(lane: int) -> tuple[list[list[Value]], list[list[Value]]]:
    slots = range(SAMPLE * lane, SAMPLE * (lane + 1))
    left = [[loaded(slot, each) for each in LEFT] for slot in slots]
    right = [[loaded(slot, each) for each in RIGHT] for slot in slots]
    return left, right


def _first_area(lane: int) -> int:
    # The sums are needed only after the search.
    return FIRST_SUM + AREAS_KEPT * lane


def _clear() -> Program:
    zero, _ = constants()
    return schedule([(FIRST_SUM + n, zero.plus(zero, zero)) for n in range(SUMS)], first=FIRST_FREE)


def _add() -> Program:
    zero, one = constants()
    sums, centre = _sums(), _centre()
    for slot in range(GROUP):
        match = [loaded(slot, each) for each in (*LEFT, *RIGHT)]
        pairs = factors(zero, one, centre, match, loaded(slot, Coordinate.WEIGHT))
        sums = [total.plus(*pair) for total, pair in zip(sums, pairs, strict=True)]
    return schedule([(FIRST_SUM + n, total) for n, total in enumerate(sums)], first=FIRST_FREE)


def _fit() -> Program:
    rows, determinant = solve_sums(*constants(), _centre(), _sums())
    return schedule(_elements(rows, lane=0), [(0, determinant)], first=FIRST_FREE)


def _sums() -> list[Value]:
    return [held(FIRST_SUM + n) for n in range(SUMS)]


def _centre() -> list[Value]:
    zero, one = constants()
    return [zero.plus(one, loaded(0, each)) for each in CENTRE]


def _elements(rows: list[list[Value]], lane: int) -> list[tuple[int, Value]]:
    elements = [each for row in rows for each in row]
    return [(FIRST_ELEMENT + LANE_REGISTERS * lane + n, each) for n, each in enumerate(elements)]


AREAS, SOLVE, CLEAR, ADD, FIT = _areas(), _solve(), _clear(), _add(), _fit()
PROGRAMS = (AREAS, SOLVE, CLEAR, ADD, FIT)
"""In the order in which the hardware's memory holds them."""
