"""What is shown of a run, a mount or a schedule, and what can be said to them: immutable types, no logic."""
