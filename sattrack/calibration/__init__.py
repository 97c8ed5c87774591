"""Finding out what a mount does with commands: signs, gains, semantics, delays and clocks. Pure, no I/O."""
