"""What all else stands on: clocks, errors, settings files, numbers and words as people write them."""
