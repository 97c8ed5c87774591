"""Many stations: passes of a catalogue over each, who follows what, and what all of them have seen."""
