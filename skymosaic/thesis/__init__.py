"""The thesis's experiments, repeated on pairs with known homographies: tables IV-1 to IV-7 and figure IV-6."""
