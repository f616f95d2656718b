"""Repeats the thesis's experiments on pairs with known homographies: tables IV-1 to IV-7 and figure IV-6."""
