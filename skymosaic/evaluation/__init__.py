"""Evaluation: metrics, pairs with known homographies, comparison of hardware with the golden model."""
