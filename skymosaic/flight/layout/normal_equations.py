"""Normal equations of a layout: one block of unknowns for each view, coupled by links."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from golden_model.arrays import Array


def factor_symmetric(matrix: csc_array) -> SuperLU:
    """Factor a symmetric matrix, in an order whose factors take half the memory of those in splu's own."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})


class BlockSystem:
    """Normal equations of a network: one block of unknowns per view, and some that all views share.

    Parameters
    ----------
    views : int
    pairs : ndarray of int, shape (L, 2)
        Left and right view of each link.
    normal : ndarray of float64, shape (L, 2 free, 2 free)
        Of each link, for the unknowns of the left and of the right view.
    target : ndarray of float64, shape (L, 2 free, 1 + S)
        The further columns are of the derivatives by the shared unknowns.
    shared : (ndarray, ndarray)
        Gradient (S,) and second derivatives (S, S) of the cost by the shared unknowns alone.
    """

    def __init__(
        self, views: int, pairs: NDArray[np.intp], normal: Array, target: Array, shared: tuple[Array, Array]
    ) -> None:
        self._pairs = pairs
        self._shared = shared
        free = normal.shape[1] // 2
        self._diagonal = np.zeros((views, free, free))
        self.target = np.zeros((views, free, target.shape[2]))
        for side in (0, 1):
            own = slice(side * free, (side + 1) * free)
            np.add.at(self._diagonal, pairs[:, side], normal[:, own, own])
            np.add.at(self.target, pairs[:, side], target[:, own])
        self._across = normal[:, :free, free:]

    def add_observations(self, views: NDArray[np.intp], rows: Array, residual: Array) -> None:
        """Add observations of one view each: weighted derivatives (N, 2, free) and weighted residuals (N, 2)."""
        np.add.at(self._diagonal, views, rows.transpose(0, 2, 1) @ rows)
        np.add.at(self.target[..., 0], views, (rows * residual[..., None]).sum(axis=1))

    def add_prior(self, values: Array, weights: Array) -> None:
        """Pull the last unknowns of every view so that ``values`` (V, k) become 0, by ``weights`` (V, k)."""
        k = values.shape[1]
        self._diagonal[:, -k:, -k:] += weights[:, :, None] * np.eye(k)
        self.target[:, -k:, 0] += values * weights

    def solve(self, reference: int, damping: Array, max_change: float) -> tuple[Array, Array]:
        """Solve for the unknowns (V, free) of the views, and the shared ones (S,), each limited to ``max_change``.

        The first four of the reference are 0. A view's own second derivatives grow by its ``damping`` (V,), as a share
        of them. Where the equations do not determine the unknowns, these are NaN.
        """
        still, per_change = self._solve(reference, damping)
        # The views are eliminated (Schur complement): they are `still` without a change, and `per_change` of it.
        rows = self.target[..., 1:]
        downhill = self._shared[0] + (rows * still[..., None]).sum(axis=(0, 1))
        curvature = self._shared[1] + (rows[..., None] * per_change[..., None, :]).sum(axis=(0, 1))
        try:
            change = np.clip(-np.linalg.solve(curvature, downhill), -max_change, max_change)
        except np.linalg.LinAlgError:  # The ties tell nothing about one of them.
            change = np.zeros(len(downhill))
        return still + (change * per_change).sum(axis=2), change

    def _solve(self, reference: int, damping: Array) -> tuple[Array, Array]:
        views, free, columns = self.target.shape
        # One block on the diagonal for each view, and one on either side of it for each link.
        corners = np.concatenate([np.stack([np.arange(views)] * 2, axis=1), self._pairs, self._pairs[:, ::-1]])
        inner = np.arange(free)
        diagonal = self._diagonal.copy()
        diagonal[:, inner, inner] *= 1 + damping[:, None]
        blocks = np.concatenate([diagonal, self._across, self._across.transpose(0, 2, 1)])
        rows = np.broadcast_to(free * corners[:, 0, None, None] + inner[:, None], blocks.shape)
        across = np.broadcast_to(free * corners[:, 1, None, None] + inner, blocks.shape)
        side = views * free
        matrix = csc_array((blocks.ravel(), (rows.ravel(), across.ravel())), shape=(side, side))
        # Ties leave position, rotation and scale of the whole open, so the reference keeps its own.
        kept = np.delete(np.arange(side), np.s_[reference * free : reference * free + 4])
        solution = np.zeros((side, columns))
        try:
            solution[kept] = -factor_symmetric(matrix[kept][:, kept]).solve(self.target.reshape(side, columns)[kept])
        except RuntimeError:  # The matrix is singular.
            solution[kept] = np.nan
        solution = solution.reshape(views, free, columns)
        return solution[..., 0], solution[..., 1:]
