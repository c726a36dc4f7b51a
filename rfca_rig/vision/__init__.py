"""Photos of the leg turned into hinge angles: where the red marks are, which mark is which, and what cannot be told."""
